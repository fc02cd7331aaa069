"""uvicorn's HTTP protocol with limits it lacks: number of connections, size of a header, time a header may take."""

import asyncio
import json
from typing import Any
from uuid import uuid4

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from app import problems
from app.settings import Settings

_LONGEST_HEADER = 64 * 1024


def bounded(settings: Settings) -> type[HttpToolsProtocol]:
    """The protocol class for these settings.

    A connection is closed when it is one too many; when no complete header has come ``stall_s`` after it was opened,
    or after the first byte that follows an answer (be it of another request, or of a body nobody waits for any more).
    """

    class BoundedProtocol(HttpToolsProtocol):
        _timer: asyncio.TimerHandle | None = None
        _header_bytes = 0

        def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
            super().connection_made(transport)
            if len(self.connections) > settings.max_connections:
                transport.close()
            else:
                self._start_timer()

        def connection_lost(self, exc: Exception | None) -> None:
            self._stop_timer()
            super().connection_lost(exc)

        def data_received(self, data: bytes) -> None:
            cycle: Any = self.cycle  # none before the first request, whatever its declared type
            if self._timer is None and (cycle is None or cycle.response_complete):
                self._start_timer()
            super().data_received(data)

        def on_message_begin(self) -> None:
            self._header_bytes = 0
            super().on_message_begin()

        def on_url(self, url: bytes) -> None:
            self._count(len(url))
            super().on_url(url)

        def on_header(self, name: bytes, value: bytes) -> None:
            self._count(len(name) + len(value))
            super().on_header(name, value)

        def on_headers_complete(self) -> None:
            self._stop_timer()
            super().on_headers_complete()

        def send_400_response(self, msg: str) -> None:
            request_id = uuid4().hex
            document = problems.body(problems.MALFORMED, "The request is not valid HTTP.", request_id)
            content = json.dumps(document).encode()
            head = (
                f"HTTP/1.1 400 Bad Request\r\ncontent-type: {problems.MEDIA_TYPE}\r\nx-request-id: {request_id}\r\n"
                f"content-length: {len(content)}\r\nconnection: close\r\n\r\n"
            )
            self.transport.write(head.encode() + content)
            self.transport.close()

        def _count(self, size: int) -> None:
            self._header_bytes += size
            if self._header_bytes > _LONGEST_HEADER:
                raise ValueError("the header is too long")  # the parser reports it, and 400 is answered

        def _start_timer(self) -> None:
            self._timer = self.loop.call_later(settings.stall_s, self.transport.close)

        def _stop_timer(self) -> None:
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None

    return BoundedProtocol
