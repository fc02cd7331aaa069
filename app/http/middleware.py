"""What surrounds every request: its id, security headers, one log line, metrics, and the answer to a defect."""

import logging
import re
import time
from collections.abc import Mapping
from typing import cast
from uuid import uuid4

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app import problems
from app.http.metrics import Metrics
from app.http.tracing import Trace

HEADER = "X-Request-ID"
# Short and plain enough to be put into logs and headers as it is.
SANE_ID = re.compile(r"[A-Za-z0-9._:-]{1,128}")
_LONGEST_PATH = 200
# A route may say otherwise, as the documentation does.
SECURITY = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",
    "Cross-Origin-Resource-Policy": "same-origin",
}
logger = logging.getLogger("prsnet.access")


def stages(request: Request) -> dict[str, float]:
    """Milliseconds of the request's stages, in their order: what is put here is logged, measured and returned."""
    return request.scope.setdefault("stages", {})


class RequestContext:
    """Gives each request an id, or keeps the client's sane ``X-Request-ID``; returns it and logs one line.

    An exception that no handler took is logged with its traceback and answered as a problem of type
    ``internal-error``; the client sees the id, never the exception.
    """

    def __init__(self, app: ASGIApp, metrics: Metrics, trace: Trace | None = None) -> None:
        self.app = app
        self._trace = trace
        self._metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one connection (ASGI)."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        claimed = Headers(scope=scope).get(HEADER, "")
        request_id = claimed if SANE_ID.fullmatch(claimed) else uuid4().hex
        scope["request_id"] = request_id
        started = time.perf_counter()
        status = 0

        async def send_with_headers(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                headers = MutableHeaders(scope=message)
                headers[HEADER] = request_id
                for name, value in SECURITY.items():
                    headers.setdefault(name, value)
                if spent := scope.get("stages"):
                    headers["Server-Timing"] = _server_timing(cast("Mapping[str, float]", spent))
            await send(message)

        try:
            await self.app(scope, receive, send_with_headers)
        except Exception:
            logger.exception(
                "defect while serving %s %r id=%s", scope["method"], scope["path"][:_LONGEST_PATH], request_id
            )
            if status:  # the answer is already on its way: the server must break the connection
                raise
            answer = problems.response(Request(scope), problems.INTERNAL, problems.INTERNAL.example)
            await answer(scope, receive, send_with_headers)
        finally:
            self._account(scope, status, time.perf_counter() - started)

    def _account(self, scope: Scope, status: int, seconds: float) -> None:
        """Log and measure a request that is over; status 0 means that nobody was left to answer."""
        method, path, spent = scope["method"], scope["path"], scope.get("stages", {})
        reason = scope.get("problem", "")
        self._metrics.observe_request(path, method, status, seconds, reason)
        self._metrics.observe_stages(spent)
        if self._trace is not None:
            self._trace(scope, status, seconds)
        fields = {
            "request_id": scope["request_id"],
            "method": method,
            "path": path[:_LONGEST_PATH],
            "status": status,
            "ms": round(seconds * 1e3, 2),
        }
        if reason:
            fields["problem"] = reason
        if spent:
            fields["stages_ms"] = {name: round(value, 2) for name, value in spent.items()}
        logger.info(
            "%s %r %d %.1f ms id=%s", method, path[:_LONGEST_PATH], status, seconds * 1e3, scope["request_id"],
            extra={"fields": fields},
        )  # fmt: skip


def _server_timing(spent: Mapping[str, float]) -> str:
    return ", ".join(f"{name};dur={value:.2f}" for name, value in spent.items())
