"""Real servers for the tests in this folder: uvicorn in a process of its own, with the shipped weights."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from .server import Server, running


@pytest.fixture(scope="session")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server with the default settings, shared by all tests that leave it as they found it."""
    with running(tmp_path_factory.mktemp("server") / "log") as started:
        yield started


@pytest.fixture(scope="session")
def strict_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A server with one worker, no queue and tight limits."""
    limits = {"WORKERS": "1", "QUEUE": "0", "MAX_UPLOAD_BYTES": "50000000", "MAX_FACES": "400000"}
    with running(tmp_path_factory.mktemp("strict") / "log", **limits) as started:
        yield started


@pytest.fixture
def data() -> Path:
    """The folder of small real meshes."""
    return Path(__file__).parents[1] / "data"
