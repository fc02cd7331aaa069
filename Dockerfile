ARG BASE_IMAGE=python:3.11-slim-bookworm
FROM ${BASE_IMAGE} AS build

# An extra package index that holds CPU builds of torch; the default one installs CUDA libraries on Linux.
ARG TORCH_INDEX=

ENV PIP_DISABLE_PIP_VERSION_CHECK=1 PIP_NO_CACHE_DIR=1 PIP_ROOT_USER_ACTION=ignore DEBIAN_FRONTEND=noninteractive
SHELL ["/bin/sh", "-euc"]

# `strip` is needed in this stage only.
RUN apt-get update -qq; apt-get install -yqq --no-install-recommends binutils >/dev/null; rm -rf /var/lib/apt/lists/*
RUN python3 -m venv --without-pip /opt/prsnet
WORKDIR /src

# Dependencies first: this layer is built anew only when they change.
COPY pyproject.toml constraints.txt ./
RUN python3 -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["dependencies"], sep="\n")' \
      >/tmp/requirements.txt; \
    python3 -m pip --python /opt/prsnet/bin/python install -q --no-compile --progress-bar off \
      ${TORCH_INDEX:+--extra-index-url "$TORCH_INDEX"} -c constraints.txt -r /tmp/requirements.txt
RUN /opt/prsnet/bin/python -c 'import importlib.metadata as m; \
names = sorted(d.metadata["Name"].lower() for d in m.distributions()); \
gpu = [n for n in names if n.startswith(("nvidia-", "cuda-", "triton"))]; \
raise SystemExit(f"GPU libraries: {gpu}. Pass --build-arg TORCH_INDEX=<index of CPU wheels>." if gpu else 0)'
# Out goes what nothing reads at run time: torch's C++ headers, its compiled and Python tests and its protobuf compiler
# (about 200 MB), other packages' tests, static archives, and the symbol tables of the two largest libraries (about
# 110 MB; dynamic symbols stay). Not stripped: numpy's bundled libraries, which `strip` is known to damage.
RUN cd /opt/prsnet/lib/python3*/site-packages; \
    rm -rf torch/include torch/test torch/share torch/bin/*Test torch/bin/test_* torch/bin/protoc*; \
    find . -name '*.a' -delete; \
    find . -type d -name tests -prune -exec rm -rf {} +; \
    strip --strip-unneeded torch/lib/libtorch_cpu.so llvmlite/binding/libllvmlite.so

COPY README.md LICENSE ./
COPY app app
COPY model model
RUN python3 -m pip --python /opt/prsnet/bin/python install -q --no-compile --no-deps .

# Compile what would otherwise be compiled at every start, since the root file system is read-only by then.
# - Kernels: numba names its cache after the CPU it compiles for, so it is told a CPU that every x86-64 host since 2009
#   covers (no slower here than the host's own name); another architecture gets LLVM's generic one.
# - numba compares the source's time stamp with the cache's, and layers keep whole seconds only: hence `touch`.
# - Python: everything but torch and sympy, of which the warm-up compiles just the modules that are used.
WORKDIR /srv
RUN case "$(uname -m)" in x86_64) cpu=x86-64-v2;; *) cpu=generic;; esac; \
    printf 'cpu_name: %s\ncpu_features: ""\n' "$cpu" >.numba_config.yaml; \
    cd /opt/prsnet/lib/python3*/site-packages; \
    find app model -name '*.py' -exec touch -d @1700000000 {} +; \
    /opt/prsnet/bin/python -m compileall -q -x '/(torch|sympy)/' . >/dev/null; \
    cd /srv; /opt/prsnet/bin/prsnet warmup

# What is in the environment, with versions and licences, as CycloneDX; the tool itself stays in this stage.
RUN python3 -m venv --without-pip /opt/sbom; \
    python3 -m pip --python /opt/sbom/bin/python install -q --no-compile --progress-bar off -c /src/constraints.txt cyclonedx-bom; \
    /opt/sbom/bin/cyclonedx-py environment --pyproject /src/pyproject.toml --mc-type application \
      --output-reproducible --of JSON -o /srv/sbom.cdx.json /opt/prsnet/bin/python

FROM ${BASE_IMAGE}
ARG VERSION=
ARG REVISION=
LABEL org.opencontainers.image.title=prsnet \
      org.opencontainers.image.description="Every mirror plane and rotation axis of a mesh, from one HTTP call" \
      org.opencontainers.image.licenses=MIT \
      org.opencontainers.image.version=${VERSION} \
      org.opencontainers.image.revision=${REVISION}
RUN useradd --system --uid 10001 --no-create-home --home-dir /tmp --shell /usr/sbin/nologin prsnet
COPY --from=build /opt/prsnet /opt/prsnet
COPY --from=build /srv /srv
# Only /tmp needs to be writable: uploads larger than memory buffers go there.
ENV PATH=/opt/prsnet/bin:$PATH PYTHONUNBUFFERED=1 PYTHONDONTWRITEBYTECODE=1 PRSNET_HOST=0.0.0.0 PRSNET_PORT=8000
WORKDIR /srv
USER 10001:10001
EXPOSE 8000
HEALTHCHECK --interval=15s --timeout=4s --start-period=60s --retries=3 CMD ["python", "-c", "\
import http.client, os; \
probe = http.client.HTTPConnection('127.0.0.1', int(os.environ['PRSNET_PORT']), timeout=3); \
probe.request('GET', '/health'); \
raise SystemExit(probe.getresponse().status != 200)"]
# The exec form: SIGTERM reaches the server itself, which finishes what runs.
CMD ["prsnet", "serve"]
