"""The documentation: its links hold, its reference is current, and every block of code in it runs."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from docs.http_reference import reference

from ..e2e.server import ROOT, Server, running

PAGES = ["index.md", "concepts.md", "recipes.md", "bulk.md", "operating.md", "http.md"]
SLOW = {"bulk.md"}
"""A page that starts Ray, which takes a minute and does not start on a busy machine: `make cluster` runs it."""
WRITTEN_IN = "http://127.0.0.1:8000"
_BLOCK = re.compile(
    r"(?P<skip><!-- not run: .+ -->\n)?^```(?P<language>\w*)\n(?P<code>.*?)^```$", re.MULTILINE | re.DOTALL
)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with running(tmp_path_factory.mktemp("docs") / "log", WORKERS="1") as started:
        yield started


def blocks(page: str) -> list[tuple[str, str]]:
    """Language and code of a page's blocks, but for those that say why they are not run."""
    found = list(_BLOCK.finditer((ROOT / "docs" / page).read_text()))
    return [(match["language"], match["code"]) for match in found if not match["skip"]]


@pytest.mark.parametrize("page", PAGES)
def test_every_block_of_code_runs(page: str, server: Server, tmp_path: Path) -> None:
    """The blocks of a page are run one after the other, as a reader would, in a folder with the test meshes."""
    if page in SLOW and "TEST_CLUSTER" not in os.environ:
        pytest.skip("starts Ray: make cluster runs it")
    for path in (ROOT / "tests" / "data").iterdir():
        shutil.copy(path, tmp_path)
    shutil.copy(tmp_path / "barrel.stl", tmp_path / "part.stl")
    shutil.copy(tmp_path / "vase.ply", tmp_path / "scan.ply")
    command = tmp_path / "bin" / "prsnet"
    command.parent.mkdir()
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m app "$@"\n')
    command.chmod(0o755)
    environment = os.environ | {"PATH": f"{command.parent}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)}
    script = tmp_path / "page.py"
    # Python blocks share their names; shell blocks between them are run where they stand.
    lines = ["import subprocess"]
    assert blocks(page)
    for language, code in blocks(page):
        assert language in ("python", "sh"), f"a block of {page} has no language that is run: {language!r}"
        code = code.replace(WRITTEN_IN, server.url)
        lines.append(code if language == "python" else f"subprocess.run(['bash', '-euc', {code!r}], check=True)")
    script.write_text("\n".join(lines))
    result = subprocess.run(
        [sys.executable, str(script)],
        cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=280, check=False,
    )  # fmt: skip
    assert result.returncode == 0, f"{page}:\n{result.stdout[-2000:]}\n{result.stderr[-4000:]}"
    assert "problems/" not in result.stdout


def test_pages_say_what_is_run() -> None:
    pages = {path.name for path in (ROOT / "docs").glob("*.md")}
    with_code = {page for page in pages if blocks(page)}
    assert with_code - set(PAGES) <= {"training.md"}  # takes hours


def test_http_reference_is_current() -> None:
    document = json.loads((ROOT / "docs" / "openapi.json").read_text())
    assert (ROOT / "docs" / "http.md").read_text() == reference(document), "renew it: python docs/http_reference.py"


def test_links_hold(tmp_path: Path) -> None:
    shutil.copytree(ROOT / "docs", tmp_path / "docs")
    shutil.copy(ROOT / "mkdocs.yml", tmp_path)
    builder = Path(sys.executable).with_name("zensical")
    result = subprocess.run(
        [builder, "build", "--strict"], cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert "No issues found" in result.stdout + result.stderr
    assert (tmp_path / "site" / "recipes.html").exists()
