"""Promises about the repository itself: dependencies, imports, packaging."""

import re
import subprocess
import sys
import tomllib
from itertools import chain
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import app

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
PACKAGES = ("app", "model", "training")


def constraint_lines() -> list[str]:
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def project_files() -> list[Path]:
    """Every file that git tracks or would add; without git, every file outside of hidden folders."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listing = subprocess.run(
        command,
        cwd=ROOT,
        capture_output=True,
        check=False,
    )
    if listing.returncode == 0:
        paths = [ROOT / name for name in listing.stdout.decode().split("\0") if name]
    else:
        paths = [p for p in ROOT.rglob("*") if not any(part.startswith(".") for part in p.relative_to(ROOT).parts)]
    return [path for path in paths if path.is_file()]


def run_python(code: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)


def test_constraints_are_exact_public_versions() -> None:
    lines = constraint_lines()
    names = [line.split("==")[0] for line in lines]
    assert all(re.fullmatch(r"[a-z0-9-]+==[0-9][0-9a-z.]*", line) for line in lines), lines
    assert names == sorted(set(names))
    assert "torch==2.13.0" in lines


def test_constraints_satisfy_every_declared_dependency() -> None:
    pinned = dict(line.split("==") for line in constraint_lines())
    declared = [*PROJECT["dependencies"], *chain.from_iterable(PROJECT["optional-dependencies"].values())]
    for requirement in map(Requirement, declared):
        name = canonicalize_name(requirement.name)
        assert name in pinned, f"{name} is declared, but not pinned: make lock"
        assert requirement.specifier.contains(pinned[name]), f"{requirement} against {pinned[name]}"


def test_no_file_names_a_package_registry() -> None:
    # Joined here, so that this file does not hold them.
    hosts = [
        ("pypi", "org"),
        ("pythonhosted", "org"),
        ("npmjs", "org"),
        ("npmjs", "com"),
        ("pytorch", "org"),
        ("debian", "org"),
        ("anaconda", "org"),
        ("docker", "io"),
        ("ghcr", "io"),
        ("quay", "io"),
    ]
    pattern = re.compile("|".join(re.escape(".".join(parts)) for parts in hosts).encode())
    found = {path.relative_to(ROOT).as_posix(): pattern.findall(path.read_bytes()) for path in project_files()}
    assert {name: hits for name, hits in found.items() if hits} == {}


def test_import_contracts_hold() -> None:
    command = Path(sys.executable).with_name("lint-imports")
    result = subprocess.run([command, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout


@pytest.mark.parametrize(
    ("modules", "absent"),
    [
        (
            "training.trainer.fit",
            "numba trimesh lxml networkx fastapi starlette uvicorn pydantic typer httpx scipy tensorboard",
        ),
        (
            "app.http.main, app.http.server, app.cli.commands, model.detector",
            "tqdm tensorboard matplotlib scipy training",
        ),
        ("model.detector", "fastapi starlette uvicorn pydantic typer httpx app training"),
    ],
)
def test_packages_import_without_what_they_must_not_need(modules: str, absent: str) -> None:
    result = run_python(f"import sys; sys.modules.update(dict.fromkeys({absent.split()!r})); import {modules}")
    assert result.returncode == 0, result.stderr


def test_files_stay_readable() -> None:
    lengths = {
        path.relative_to(ROOT).as_posix(): len(path.read_text(encoding="utf-8").splitlines())
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
    }
    assert len(lengths) > 20
    assert {name: length for name, length in lengths.items() if length > 400} == {}


def test_the_version_is_said_once_and_has_a_changelog_entry() -> None:
    assert PROJECT["dynamic"] == ["version"]
    assert f"## [{app.__version__}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_shipped_weights_come_with_their_metadata() -> None:
    weights = sorted((ROOT / "model" / "weights").glob("*.safetensors"))
    assert {path.stem for path in weights} >= {"default", "paper"}
    assert all(path.with_suffix(".json").is_file() for path in weights)


def test_the_base_image_can_be_chosen() -> None:
    lines = (ROOT / "Dockerfile").read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("ARG BASE_IMAGE=python:")
    assert [line.split()[1] for line in lines if line.startswith("FROM")] == ["${BASE_IMAGE}"] * 2
    assert not any(re.match(r"#\s*syntax\s*=", line) for line in lines)


@pytest.mark.parametrize(
    ("command", "absent"),
    [
        ("from app.cli.commands import main; sys.argv = ['prsnet', 'detect', 'tests/data/chair.obj']; main()", "httpx"),
        ("from model import Detector; Detector.load().detect('tests/data/chair.obj', mode='paper')", "pydantic typer"),
    ],
)
def test_what_a_short_command_need_not_load_is_not_loaded(command: str, absent: str) -> None:
    """Importing torch and the web stack took twice as long as everything else from the prompt to the answer."""
    unwanted = f"torch fastapi starlette uvicorn trimesh {absent}".split()
    told = f"import atexit, sys; atexit.register(lambda: print('loaded', sorted(set({unwanted}) & set(sys.modules))))"
    result = run_python(f"{told}; {command}")
    assert result.returncode == 0, result.stderr
    assert result.stdout.splitlines()[-1] == "loaded []"
