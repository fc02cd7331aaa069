"""uvicorn's HTTP protocol with the limits it lacks: what one connection, and all of an address, may cost the server.

One request at a time is read from a connection; what was sent ahead waits in the kernel. Work that will not be taken is
refused here (`app.http.gate`), before a request is made of it, and much of it earlier still (`app.http.door`). An
answer that comes before its upload has ended reaches clients that send all of it first: the rest is read and thrown
away. When connections get scarce, idle ones go first.
"""

import asyncio
import json
from collections import Counter
from typing import Any
from uuid import uuid4

import httptools
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from app import problems
from app.http.gate import Arrival, Gate
from app.settings import Settings

_LONGEST_HEADER = 64 * 1024
_MOST_HELD = 64 * 1024
_END = b"\r\n\r\n"


class _Connections:
    """All connections of a server: how many an address has, and which are idle, the longest so first."""

    def __init__(self) -> None:
        self.of: Counter[str] = Counter()
        self.idle: dict[Any, None] = {}

    def enter(self, address: str) -> None:
        self.of[address] += 1

    def longest_idle(self, address: str | None) -> Any:
        """The connection, of any address or of one, that has been idle for the longest; None if none is."""
        return next((one for one in self.idle if address is None or one.address == address), None)

    def leave(self, address: str) -> None:
        self.of[address] -= 1
        if not self.of[address]:
            del self.of[address]


class _Lingering:
    """The transport as a request sees it: closed only when the client can have read the answer."""

    def __init__(self, protocol: Any) -> None:
        self._protocol = protocol

    def write(self, data: bytes) -> None:
        self._protocol.transport.write(data)

    def is_closing(self) -> bool:
        return self._protocol.transport.is_closing()

    def close(self) -> None:
        self._protocol.end()


def bounded(settings: Settings, gate: Gate) -> type[HttpToolsProtocol]:
    """The protocol class of one server.

    A connection is closed when it is one too many and none is idle; when no complete header has come ``stall_s`` after
    it was opened, or after the first byte that follows an answer; when an answer is not taken for as long.
    """
    known = _Connections()

    class BoundedProtocol(HttpToolsProtocol):
        _timer: asyncio.TimerHandle | None = None
        _last_timer: asyncio.TimerHandle | None = None
        _header_bytes = 0
        _tail = b""  # of a header whose end has not come
        _held = b""  # what came after the request that is being answered
        _is_held_due = False  # it is about to be read
        _in_request = False  # from the end of its header to the end of its body
        _is_answering = False  # until its answer is complete
        _is_refused = False
        _is_ending = False
        _is_last = False  # no other request will be read
        _left: int | None = None  # of its body, if that is known
        arrival: Arrival | None = None  # for which it was let in, and which its first request takes the place of
        address = ""

        # Connections

        def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
            super().connection_made(transport)
            self.address = self.client[0] if self.client else ""
            known.enter(self.address)
            crowd = 0 if settings.client_address_header else known.of[self.address]
            is_crowded = crowd > settings.connections_per_address > 0
            if is_crowded or len(self.connections) > settings.max_connections:
                victim = known.longest_idle(self.address if is_crowded else None)
                if victim is None:
                    transport.abort()
                    return
                known.idle.pop(victim)
                victim.transport.abort()
            known.idle[self] = None
            self._start_timer()

        def connection_lost(self, exc: Exception | None) -> None:
            known.leave(self.address)
            known.idle.pop(self, None)
            self._stop_timer()
            if self._last_timer is not None:
                self._last_timer.cancel()
            super().connection_lost(exc)

        def end(self) -> None:
            """Say nothing more. The client may take what was said, and say the rest of what it began, for a while."""
            if self._is_ending or self.transport.is_closing():
                return
            self._is_ending = True
            self._stop_timer()
            known.idle[self] = None
            self._last_timer = self.loop.call_later(settings.stall_s, self.transport.abort)
            if self._in_request and self.transport.can_write_eof():
                self.transport.write_eof()
                self.flow.resume_reading()
            else:
                self.transport.close()

        def timeout_keep_alive_handler(self) -> None:
            self.end()

        def shutdown(self) -> None:
            if self._is_answering:
                super().shutdown()
            else:
                self.end()

        # What comes

        def data_received(self, data: bytes) -> None:
            if self.parser is None or (self._is_ending and not self._in_request):
                return
            if self._is_held_due or (self._is_answering and not self._in_request):
                self._hold(data)
                return
            if self._timer is None and not self._in_request:
                self._start_timer()
            self._unset_keepalive_if_required()
            self._feed(data)

        def _hold(self, data: bytes) -> None:
            self._held += data
            if len(self._held) > _MOST_HELD:  # more than anyone sends ahead in good faith
                self._held = b""
                self._is_last = True
            self.flow.pause_reading()

        def _feed(self, data: bytes) -> None:
            """Give the parser what belongs to one request, and keep the rest."""
            while data and not self.transport.is_closing():
                if self._is_answering and not self._in_request:
                    self._hold(data)
                    return
                piece = self._piece(data)
                data = data[len(piece) :]
                try:
                    parser: Any = self.parser
                    parser.feed_data(piece)
                except httptools.HttpParserUpgrade:
                    pass  # there is nothing to upgrade to; the request is answered as it is
                except httptools.HttpParserError:
                    if self._is_answering and not self._in_request:  # an answer is on its way: the last one
                        self._is_last = True
                    else:
                        self.send_400_response("")
                    return

        def _piece(self, data: bytes) -> bytes:
            if self._in_request:
                if self._left is None:
                    return data  # chunked: where it ends only the parser knows
                piece = data[: self._left]
                self._left -= len(piece)
                return piece
            at = (self._tail + data).find(_END)
            if at < 0:
                self._tail = (self._tail + data)[-len(_END) + 1 :]
                return data
            piece = data[: at + len(_END) - len(self._tail)]
            self._tail = b""
            return piece

        # What the parser says

        def on_message_begin(self) -> None:
            if self._is_answering:
                raise ValueError("a request within a request")
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
            known.idle.pop(self, None)
            self._in_request = self._is_answering = True
            fields = dict(self.headers)
            length = fields.get(b"content-length", b"0")
            self._left = None if b"transfer-encoding" in fields else int(length)
            path = httptools.parse_url(self.url).path
            parser: Any = self.parser
            method = parser.get_method()
            if self.arrival is not None:
                self.arrival.end()
            refusal = gate.refusal(method, path, self.headers, self.address)
            if refusal is None:
                super().on_headers_complete()
                self.cycle.transport = _Lingering(self)  # type: ignore[assignment]
                self.scope["abort"] = self.transport.abort  # type: ignore[typeddict-unknown-key]
                if gate.guards(method, path):
                    self.scope["arrival"] = Arrival(gate, gate.client(self.headers, self.address))  # type: ignore[typeddict-unknown-key]
                return
            self._is_refused = True
            left = self._left
            keep = parser.should_keep_alive() and self._left is not None and not self.expect_100_continue
            self.transport.write(gate.answer(refusal, path, self.headers, keep=keep))
            if not keep or left is None or left > settings.max_upload_bytes:
                self.end()
            else:  # the rest of the body is thrown away, but not for ever
                self._start_timer()

        def on_body(self, body: bytes) -> None:
            if not self._is_refused:
                super().on_body(body)

        def on_message_complete(self) -> None:
            self._in_request = False
            if self._is_ending:
                self.transport.close()
            elif self._is_refused:
                self._stop_timer()
                self._is_refused = False
                self._next()
            else:
                super().on_message_complete()
                if self.cycle.response_complete:
                    self._stop_timer()
                    self._next()

        def on_response_complete(self) -> None:
            super().on_response_complete()
            if self._in_request:  # the answer came early; what is left of the body must not take for ever
                self._start_timer()
            else:
                self._next()

        def _next(self) -> None:
            """The request is over: on to what was sent ahead."""
            self._is_answering = False
            if self.transport.is_closing() or self._is_ending:
                return
            if self._is_last:
                self.end()
                return
            known.idle[self] = None
            if self.timeout_keep_alive_task is None:
                self.timeout_keep_alive_task = self.loop.call_later(
                    self.timeout_keep_alive, self.timeout_keep_alive_handler
                )
            if self._held:  # later, lest requests sent ahead be answered within each other
                self._is_held_due = True
                self.loop.call_soon(self._read_held)
            else:
                self.flow.resume_reading()

        def _read_held(self) -> None:
            """What was sent ahead comes before what has arrived in the meantime: the loop may have read on."""
            self._is_held_due = False
            held, self._held = self._held, b""
            if self.transport.is_closing():
                return
            self.flow.resume_reading()
            self.data_received(held)

        def send_400_response(self, msg: str) -> None:
            request_id = uuid4().hex
            document = problems.body(problems.MALFORMED, "The request is not valid HTTP.", request_id)
            content = json.dumps(document).encode()
            head = (
                f"HTTP/1.1 400 Bad Request\r\ncontent-type: {problems.MEDIA_TYPE}\r\nx-request-id: {request_id}\r\n"
                f"content-length: {len(content)}\r\nconnection: close\r\n\r\n"
            )
            self.transport.write(head.encode() + content)
            self._in_request = True  # nobody knows where it ends
            self.end()
            self._in_request = False

        # Clients that do not read

        def pause_writing(self) -> None:
            super().pause_writing()
            if self._last_timer is None:
                self._last_timer = self.loop.call_later(settings.stall_s, self.transport.abort)

        def resume_writing(self) -> None:
            super().resume_writing()
            if self._last_timer is not None and not self._is_ending:
                self._last_timer.cancel()
                self._last_timer = None

        def _count(self, size: int) -> None:
            self._header_bytes += size
            if self._header_bytes > _LONGEST_HEADER:
                raise ValueError("the header is too long")  # the parser reports it, and 400 is answered

        def _start_timer(self) -> None:
            self._stop_timer()
            self._timer = self.loop.call_later(settings.stall_s, self.end)

        def _stop_timer(self) -> None:
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None

    return BoundedProtocol
