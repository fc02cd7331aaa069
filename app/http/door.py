"""Where connections come in: a request for work that will not be taken is answered before its connection costs much.

Ten times what can be served is mostly connections that end with a refusal, and to make a transport, a protocol and its
timers for each costs more than the refusal. So the first bytes are looked at before any of that is made: where they
hold a whole header and `app.http.gate` refuses it for want of room, it is answered, and the connection ended. All
others get uvicorn's protocol (`app.http.protocol`), with their bytes unread.
"""

import asyncio
import contextlib
import logging
import socket
from collections.abc import Callable, Sequence
from http import HTTPStatus
from typing import Any

import httptools

from app.http.gate import Arrival, Gate

logger = logging.getLogger("prsnet")

_BACKLOG = 2048
_AT_A_TIME = 16  # then others have their turn
_LOOKED_AT = 64 * 1024
_DEFER_S = 1
_PAUSE_S = 0.5  # when there are no descriptors
_GATHER_S = 0.01
_SWEEP_S = 1.0
# Plain numbers: to combine flags costs microseconds.
_NOW = int(socket.MSG_DONTWAIT)
_PEEK = int(socket.MSG_PEEK | socket.MSG_DONTWAIT)
_WITH_THE_END = _NOW | int(getattr(socket, "MSG_MORE", 0))  # what is sent goes in one packet with the end


def listen(host: str, port: int) -> list[socket.socket]:
    """Sockets that listen on all addresses of ``host``.

    Raises:
        OSError: one of them cannot be had.
    """
    found = socket.getaddrinfo(host or None, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    sockets: list[socket.socket] = []
    try:
        for family, _, _, _, address in dict.fromkeys(found):
            one = socket.socket(family, socket.SOCK_STREAM)
            sockets.append(one)
            one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if family == socket.AF_INET6:
                one.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            with contextlib.suppress(AttributeError, OSError):
                # Linux: connections come with their first bytes, or after a second or two without any.
                one.setsockopt(socket.IPPROTO_TCP, socket.TCP_DEFER_ACCEPT, _DEFER_S)
            one.setblocking(False)
            one.bind(address)
            one.listen(_BACKLOG)
    except OSError:
        for one in sockets:
            one.close()
        raise
    return sockets


class _Request:
    """What of a request decides whether it is let in, and whether more comes after it; the parser calls it."""

    def __init__(self) -> None:
        self.parser: Any = httptools.HttpRequestParser(self)
        self.size = 0  # bytes that have come
        self.url = self.method = self.path = b""
        self.headers: list[tuple[bytes, bytes]] = []
        self.begun = 0
        self.has_header = self.is_last = self.is_whole = False

    def on_message_begin(self) -> None:
        self.begun += 1

    def on_url(self, url: bytes) -> None:
        self.url += url

    def on_header(self, name: bytes, value: bytes) -> None:
        self.headers.append((name.lower(), value))

    def on_headers_complete(self) -> None:
        self.has_header = True
        self.is_last = not self.parser.should_keep_alive()

    def on_message_complete(self) -> None:
        self.is_whole = True


class Door(asyncio.AbstractServer):
    """Accepts the connections of ``sockets``; ``protocol`` makes what serves one that is let in.

    What it is let in for is told to it, so that all that come at the same moment do not rely on one place.

    A refused client may say the rest of what it began for ``linger_s``; so many at most are left that time.
    """

    def __init__(
        self,
        sockets: Sequence[socket.socket],
        gate: Gate,
        protocol: Callable[[Arrival | None], asyncio.BaseProtocol],
        linger_s: float,
        most_lingering: int,
    ) -> None:
        self.sockets = tuple(sockets)
        self._gate = gate
        self._protocol = protocol
        self._linger_s, self._most_lingering = linger_s, most_lingering
        self._loop = asyncio.get_running_loop()
        self._seen = memoryview(bytearray(_LOOKED_AT))
        self._entering: set[asyncio.Task[Any]] = set()
        self._lingering: dict[socket.socket, float] = {}  # until when, the first so first
        for one in self.sockets:
            self._loop.add_reader(one.fileno(), self._accept, one)

    @property
    def lingering(self) -> int:
        """Refused clients that have not hung up."""
        return len(self._lingering)

    def close(self) -> None:
        """Accept no more."""
        for one in self.sockets:
            if one.fileno() >= 0:
                self._loop.remove_reader(one.fileno())
                one.close()

    async def wait_closed(self) -> None:
        """Return when those that were accepted have their protocol; who was refused need not be waited for."""
        if self._entering:
            await asyncio.wait(self._entering)
        for connection in list(self._lingering):
            self._leave(connection)

    def _accept(self, listening: socket.socket) -> None:
        has_refused = False
        for _ in range(_AT_A_TIME):
            try:
                connection, address = listening.accept()
            except (BlockingIOError, InterruptedError, ConnectionAbortedError):
                break
            except OSError as error:  # no descriptor or no memory is left: to try again at once would be a busy loop
                logger.error("no connection can be accepted: %s", error)
                self._wait(listening, _PAUSE_S)
                return
            peer = str(address[0])
            request = self._look(connection)
            if self._refuse(connection, request, peer):
                has_refused = True
            else:
                self._enter(connection, request, peer)
        else:
            return  # there may be more, which come after what else there is to do
        if has_refused and self._gate.has_reserve:
            # Some at a time cost less than one after the other, each of which would interrupt a worker.
            self._wait(listening, _GATHER_S)

    def _wait(self, listening: socket.socket, seconds: float) -> None:
        """Accept no more for a while."""
        self._loop.remove_reader(listening.fileno())
        self._loop.call_later(seconds, self._accept_again, listening)

    def _accept_again(self, listening: socket.socket) -> None:
        if listening.fileno() >= 0:
            self._loop.add_reader(listening.fileno(), self._accept, listening)

    def _look(self, connection: socket.socket) -> _Request:
        """What has come of its first request."""
        request = _Request()
        # Whatever is wrong with it, the protocol knows what to say.
        with contextlib.suppress(OSError, httptools.HttpParserError, httptools.HttpParserUpgrade):
            request.size = connection.recv_into(self._seen, 0, _PEEK)
            request.parser.feed_data(self._seen[: request.size])
            if request.has_header:
                request.method, request.path = request.parser.get_method(), httptools.parse_url(request.url).path
        return request

    def _enter(self, connection: socket.socket, request: _Request, peer: str) -> None:
        arrival = None
        if self._gate.guards(request.method, request.path):
            arrival = Arrival(self._gate, self._gate.client(request.headers, peer))

        async def enter() -> None:
            with contextlib.suppress(OSError):  # it has gone
                await self._loop.connect_accepted_socket(lambda: self._protocol(arrival), connection)

        task = self._loop.create_task(enter())
        self._entering.add(task)
        task.add_done_callback(self._entering.discard)

    def _refuse(self, connection: socket.socket, request: _Request, peer: str) -> bool:
        """Whether it was refused: there is nothing more to do about this connection."""
        refusal = self._gate.refusal(request.method, request.path, request.headers, peer)
        if refusal is None or not (request.is_last or refusal.status == HTTPStatus.SERVICE_UNAVAILABLE):
            return False
        is_over = request.is_last and request.is_whole and request.begun == 1
        if not is_over and len(self._lingering) >= self._most_lingering:
            return False
        try:
            # All that came is read: else the kernel would take the answer back when the connection is closed.
            connection.recv_into(self._seen, request.size, _NOW)
            answer = self._gate.answer(refusal, request.path, request.headers, keep=False)
            connection.send(answer, _WITH_THE_END)
            if is_over:
                connection.close()
            else:
                connection.shutdown(socket.SHUT_WR)
                self._linger(connection)
        except OSError:  # it has gone
            connection.close()
        return True

    def _linger(self, connection: socket.socket) -> None:
        if not self._lingering:
            self._loop.call_later(_SWEEP_S, self._sweep)
        self._lingering[connection] = self._loop.time() + self._linger_s
        self._loop.add_reader(connection.fileno(), self._discard, connection)

    def _discard(self, connection: socket.socket) -> None:
        """What a refused client still sends is read and thrown away, until it hangs up."""
        try:
            if connection.recv_into(self._seen, 0, _NOW):
                return
        except BlockingIOError:
            return
        except OSError:
            pass
        self._leave(connection)

    def _leave(self, connection: socket.socket) -> None:
        self._lingering.pop(connection)
        self._loop.remove_reader(connection.fileno())
        connection.close()

    def _sweep(self) -> None:
        now = self._loop.time()
        for connection in [one for one, until in self._lingering.items() if until < now]:
            self._leave(connection)
        if self._lingering:
            self._loop.call_later(_SWEEP_S, self._sweep)
