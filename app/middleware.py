"""What surrounds every request: its id, one log line, and the answer to a defect."""

import logging
import re
import time
from uuid import uuid4

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from app import problems

HEADER = "X-Request-ID"
# Short and plain enough to be put into logs and headers as it is.
_SANE_ID = re.compile(r"[A-Za-z0-9._:-]{1,128}")
logger = logging.getLogger("prsnet.access")


class RequestContext:
    """Gives each request an id, or keeps the client's sane ``X-Request-ID``; returns it and logs one line.

    An exception that no handler took is logged with its traceback and answered as a problem of type
    ``internal-error``; the client sees the id, never the exception.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one connection (ASGI)."""
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        claimed = Headers(scope=scope).get(HEADER, "")
        request_id = claimed if _SANE_ID.fullmatch(claimed) else uuid4().hex
        scope["request_id"] = request_id
        started = time.perf_counter()
        status = 0

        async def send_with_id(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                MutableHeaders(scope=message)[HEADER] = request_id
            await send(message)

        try:
            await self.app(scope, receive, send_with_id)
        except Exception:
            logger.exception("defect while serving %s %r id=%s", scope["method"], scope["path"], request_id)
            if status:  # the answer is already on its way: the server must break the connection
                raise
            answer = problems.response(Request(scope), problems.INTERNAL, problems.INTERNAL.example)
            await answer(scope, receive, send_with_id)
        finally:
            logger.info(
                "%s %r %d %.1f ms id=%s",
                scope["method"],
                scope["path"],
                status,
                (time.perf_counter() - started) * 1e3,
                request_id,
            )
