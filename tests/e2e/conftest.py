"""Real servers for the tests in this folder: uvicorn in a process of its own, with the shipped weights."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

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


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """One browser for this module. Not for longer: its event loop would be in the way of other tests."""
    from .browser import CHROMIUM, chromium  # here: the other tests need no browser

    assert CHROMIUM, "CI needs a Chromium: see .ci/run"
    with chromium() as started:
        yield started


@pytest.fixture
def visit(browser: Any) -> Iterator[Callable[..., Any]]:
    """Opens the viewer. In the end: no error on any page, and no request to any other host."""
    from .visits import DEFAULT, Visit

    visits: list[Visit] = []

    def open_page(url: str, *, go: bool = True, **options: Any) -> Any:
        context = browser.new_context(**(DEFAULT | options))
        visit = Visit(context.new_page(), url)
        visit.page.on("console", lambda message: message.type == "error" and visit.errors.append(message.text))
        visit.page.on("pageerror", lambda error: visit.errors.append(str(error)))
        visit.page.on("request", lambda request: visit.asked.append(request.url))
        visits.append(visit)
        if go:
            visit.page.goto(url)
        return visit

    yield open_page
    for each in visits:
        foreign = [address for address in each.asked if not address.startswith((each.url, "data:", "blob:"))]
        each.page.context.close()
        assert foreign == []
        assert each.errors == []


@pytest.fixture
def at_home(visit: Callable[..., Any], server: Server) -> Any:
    """The start page of a service with default settings."""
    return visit(server.url)
