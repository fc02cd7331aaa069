"""Optional API keys. Health is never behind them; a load balancer has none."""

from typing import cast

from fastapi import Request

from app.http.runtime import Runtime
from app.problems import UNAUTHORIZED, ProblemError
from app.schemas import KEY_HEADER

HEADER = KEY_HEADER


async def require_key(request: Request) -> None:
    """Pass when no keys are configured, or the request has one: ``X-API-Key``, or ``Authorization: Bearer``.

    It waits for nothing; as a coroutine it is not sent to another thread.

    Raises:
        ProblemError: ``unauthorized`` (401).
    """
    if not cast(Runtime, request.app.state.runtime).gate.knows(request.headers.raw):
        raise ProblemError(UNAUTHORIZED, UNAUTHORIZED.example, {"WWW-Authenticate": "Bearer"})
