"""Optional API keys. Health is never behind them; a load balancer has none."""

import hashlib
import hmac
from typing import cast

from fastapi import Request

from app.http.runtime import Runtime
from app.problems import UNAUTHORIZED, ProblemError
from app.schemas import KEY_HEADER

HEADER = KEY_HEADER


def require_key(request: Request) -> None:
    """Pass when no keys are configured, or the request has one: ``X-API-Key``, or ``Authorization: Bearer``.

    Raises:
        ProblemError: ``unauthorized`` (401).
    """
    keys = cast(Runtime, request.app.state.runtime).key_digests
    if not keys:
        return
    scheme, _, token = request.headers.get("authorization", "").partition(" ")
    given = request.headers.get(HEADER) or (token.strip() if scheme.lower() == "bearer" else "")
    # Digests are of one length, and every key is compared: the time taken tells nothing about any of them.
    digest = hashlib.sha256(given.encode()).digest()
    matches = [hmac.compare_digest(digest, key) for key in keys]
    if not any(matches):
        raise ProblemError(UNAUTHORIZED, UNAUTHORIZED.example, {"WWW-Authenticate": "Bearer"})
