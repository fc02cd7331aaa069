"""docs/training.md, "From nothing to a served model": its commands, word for word, with fewer shapes and steps."""

import json
import os
import re
import socket
import subprocess
import sys
import time
from pathlib import Path

import httpx
import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
START_LIMIT_S = 180


def blocks() -> dict[str, str]:
    """The shell commands of the section by the mark in front of each."""
    text = (ROOT / "docs" / "training.md").read_text(encoding="utf-8")
    return dict(re.findall(r"<!-- ([a-z ]+) -->\n```sh\n(.*?)```", text, re.DOTALL))


def replaced(text: str, *changes: tuple[str, str]) -> str:
    for old, new in changes:
        assert old in text, f"the document no longer says {old!r}"
        text = text.replace(old, new)
    return text


def shell(command: str, folder: Path) -> str:
    result = subprocess.run(
        ["bash", "-euc", command], cwd=folder, env=environment(), capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def environment() -> dict[str, str]:
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PRSNET_")}
    return {**kept, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}


@pytest.mark.timeout(600)
def test_from_nothing_to_a_served_model(tmp_path: Path):
    commands = blocks()
    assert set(commands) == {"from nothing", "make", "serve", "ask"}
    python = (".venv/bin/python", sys.executable)
    shell(replaced(commands["from nothing"], python, ("--count 2000", "--count 12")), tmp_path)
    making = replaced(commands["make"], python, ("--workers 2", "--workers 1"), ("--steps 14000", "--steps 2"))
    said = shell(making, tmp_path)
    assert "12 shapes prepared, 0 skipped" in said
    metadata = json.loads((tmp_path / "mine.json").read_text())
    assert metadata["name"] == "mine"
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = str(probe.getsockname()[1])
    serving = replaced(commands["serve"], (".venv/bin/prsnet", f"exec {sys.executable} -m app"), ("8000", port))
    serving = serving.replace("PRSNET_WEIGHTS=", "export PRSNET_WEIGHTS=").replace(" exec", "; exec")
    with (tmp_path / "server.log").open("wb") as log:
        server = subprocess.Popen(["bash", "-euc", serving], cwd=tmp_path, env=environment(), stdout=log, stderr=log)
    try:
        wait_until_ready(server, f"http://127.0.0.1:{port}/health", tmp_path / "server.log")
        answer = json.loads(shell(replaced(commands["ask"], ("curl ", "curl -sS "), ("8000", port)), tmp_path))
    finally:
        server.terminate()
        server.wait(30)
    assert answer["model"] == {"name": "mine", "version": metadata["version"], "sha256": metadata["sha256"]}
    for plane in answer["planes"]:
        assert abs(np.linalg.norm(plane["normal"]) - 1.0) < 1e-6


def wait_until_ready(server: "subprocess.Popen[bytes]", health: str, log: Path) -> None:
    end = time.monotonic() + START_LIMIT_S
    while time.monotonic() < end:
        assert server.poll() is None, log.read_text()
        try:
            if httpx.get(health, timeout=5).status_code == 200:
                return
        except httpx.TransportError:
            pass
        time.sleep(0.2)
    raise AssertionError(f"not ready after {START_LIMIT_S} s:\n{log.read_text()}")
