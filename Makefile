# One target for each thing a person does. `make` alone lists them.
# Variables: PORT, PYTHON (any Python >= 3.11), TORCH_INDEX (an extra package index with CPU builds of torch),
# VENV, IMAGE. Serving installs what serving needs; testing and checking add the extras `train` and `dev`.

PORT ?= 8000
VENV ?= .venv
IMAGE ?= prsnet
TORCH_INDEX ?=
PLATFORMS ?=
PYTHON ?= $(shell for p in python3 python3.11 python3.12 python3.13 python3.14; do \
	"$$p" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && echo "$$p" && break; done)

BIN := $(VENV)/bin
INSTALL = $(BIN)/python -m pip install -qq -c constraints.txt $(if $(TORCH_INDEX),--extra-index-url "$(TORCH_INDEX)")

.DEFAULT_GOAL := help
.PHONY: help serve test check format bench soak cluster audit image train docs viewer viewer-check lock clean

help: ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(firstword $(MAKEFILE_LIST)) | sed -E 's/:[^#]*## /\t/' | expand -t 14

serve: $(VENV)/.serve ## serve on http://127.0.0.1:8000 with the shipped weights (PORT= to change)
	@exec $(BIN)/prsnet serve --port $(PORT)

test: $(VENV)/.dev ## run the tests (ARGS= goes to pytest)
	@$(BIN)/python -m pytest -n auto --dist loadfile $(ARGS)

check: $(VENV)/.dev ## format, lint, types, import rules
	@$(BIN)/ruff format --check -q . && $(BIN)/ruff check -q .
	@$(BIN)/pyright --pythonpath $(BIN)/python
	@$(BIN)/lint-imports --no-cache

format: $(VENV)/.dev ## format the code and fix what the linter can fix
	@$(BIN)/ruff check -q --fix . ; $(BIN)/ruff format -q .

bench: $(VENV)/.dev ## time and memory from bytes to symmetries, by size, shape and format (minutes; ARGS=--help)
	@$(BIN)/python -m benchmarks.performance $(ARGS)

soak: $(VENV)/.dev ## the long tests: 20,000 requests, hostile files, chaos, overload, fuzzing (QUICK=1: in minutes)
	@TEST_FUZZ=$(if $(QUICK),2,50) $(BIN)/python -m pytest tests/model/formats/test_fuzz_readers.py --timeout 3600
	@for part in hostile load isolation health attacks chaos soak; do echo; $(BIN)/python benchmarks/reliability.py $$part \
		$(if $(QUICK),--seconds 4 --requests 2000) || exit 1; done

cluster: $(VENV)/.dev ## the tests that start Ray on several nodes, and kill nodes and processes (minutes, on an idle machine)
	@TEST_CLUSTER=1 $(BIN)/python -m pytest tests/app/bulk tests/docs tests/training/trainer/test_distributed.py -n 0 --timeout 900

audit: $(VENV)/.dev ## known vulnerabilities of the pinned dependencies
	@$(BIN)/python .ci/audit.py

train: $(VENV)/.dev ## train on PREPARED= (made by `python -m training prepare` and `label`); ARGS= goes to `fit`
	@test -n "$(PREPARED)" || { echo 'usage: make train PREPARED=folder [ARGS=...]' >&2; exit 2; }
	@$(BIN)/python -m training fit $(PREPARED) $(ARGS)

docs: $(VENV)/.dev ## build the documentation into site/, broken links being errors
	@$(BIN)/zensical build --clean --strict

image: ## build the container image (ENGINE=docker or podman; PLATFORMS=linux/amd64,linux/arm64 for several machines)
	$(ENGINE) build $(if $(PLATFORMS),--platform $(PLATFORMS)) --build-arg TORCH_INDEX="$(TORCH_INDEX)" \
		--build-arg VERSION="$(shell sed -nE 's/^__version__ = "(.*)"/\1/p' model/__init__.py)" \
		--build-arg REVISION="$(shell git rev-parse HEAD 2>/dev/null)" -t $(IMAGE) .

viewer: ## build app/static/viewer from app/viewer (needs Node 20 or newer and npm)
	@cd app/viewer && npm ci --ignore-scripts --loglevel=error && npm run --silent format && npm run --silent build

viewer-check: ## whether app/static/viewer is what app/viewer builds; its types, format, unit tests (needs Node and npm)
	@cd app/viewer && npm ci --ignore-scripts --loglevel=error && npm run --silent check && npm run --silent test
	@cd app/viewer && rm -rf node_modules/.built && npm run --silent build -- --out=node_modules/.built
	@diff -rq app/viewer/node_modules/.built app/static/viewer || \
		{ echo 'app/static/viewer is not what app/viewer builds: run `make viewer` and commit it' >&2; exit 1; }

lock: $(VENV)/.dev ## write constraints.txt from what is installed in the virtual environment
	@$(BIN)/python .ci/lock.py > constraints.txt.new && mv constraints.txt.new constraints.txt

clean: ## remove the virtual environment and caches
	rm -rf $(VENV) build *.egg-info .pytest_cache .ruff_cache .import_linter_cache .hypothesis

ENGINE ?= $(shell command -v docker || command -v podman || echo docker)

# The stamps make the second call fast: pip runs again only when what it was told has changed.
$(VENV)/.serve: pyproject.toml constraints.txt | $(BIN)/python
	@echo 'Installing the service into $(VENV) (the first time takes some minutes: torch is large) ...'
	@$(INSTALL) -e .
	@touch $@

$(VENV)/.dev: pyproject.toml constraints.txt | $(BIN)/python
	@echo 'Installing the service, training and development tools into $(VENV) (the first time takes some minutes) ...'
	@$(INSTALL) -e '.[train,dev,docs,otel,bulk]'
	@touch $(VENV)/.serve $@

$(BIN)/python:
	@test -n "$(PYTHON)" || { echo 'Python 3.11 or newer with the venv module is needed, and none was found' \
		'(on Debian: apt install python3 python3-venv). PYTHON=/path/to/python names one elsewhere.' >&2; exit 1; }
	@$(PYTHON) -m venv $(VENV)
