"""Fixtures of the tests in this folder; what they hand out is in ``fakes``."""

from collections.abc import Callable
from typing import Any

import httpx
import pytest

from .fakes import DATA, FakeDetector, Serving, serve_in_memory


@pytest.fixture
def anyio_backend() -> str:
    return "asyncio"


@pytest.fixture
def detector() -> FakeDetector:
    return FakeDetector()


@pytest.fixture
def serving() -> Serving:
    """``async with serving(detector, **settings) as (client, runtime)``: a started application."""
    return serve_in_memory


@pytest.fixture
def chair() -> bytes:
    return (DATA / "chair.obj").read_bytes()


@pytest.fixture
def assert_problem() -> Callable[..., dict[str, Any]]:
    """Checks that a response is a complete problem document of one type, and returns it."""

    def check(response: httpx.Response, slug: str, status: int) -> dict[str, Any]:
        assert response.headers["content-type"] == "application/problem+json", response.text
        document = response.json()
        assert (document["type"], response.status_code) == (f"/problems/{slug}", status), document
        assert document["status"] == status
        assert document["request_id"] == response.headers["x-request-id"]
        assert document["title"]
        assert document["detail"].endswith((".", "URL."))
        return document

    return check
