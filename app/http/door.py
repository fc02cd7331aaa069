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

from app.http.gate import Gate

logger = logging.getLogger("prsnet")

_BACKLOG = 2048
_AT_A_TIME = 32  # then others have their turn
_LOOKED_AT = 64 * 1024
_DEFER_S = 1
_PAUSE_S = 0.5
_SWEEP_S = 1.0
_MORE: int = getattr(socket, "MSG_MORE", 0)


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
        self.url = b""
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
    """Accepts the connections of ``sockets``; ``protocol`` makes what serves those that are let in.

    A refused client may say the rest of what it began for ``linger_s``; so many at most are left that time.
    """

    def __init__(
        self,
        sockets: Sequence[socket.socket],
        gate: Gate,
        protocol: Callable[[], asyncio.BaseProtocol],
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
        for _ in range(_AT_A_TIME):
            try:
                connection, address = listening.accept()
            except (BlockingIOError, InterruptedError, ConnectionAbortedError):
                return
            except OSError as error:  # no descriptor or no memory is left: to try again at once would be a busy loop
                logger.error("no connection can be accepted: %s", error)
                self._loop.remove_reader(listening.fileno())
                self._loop.call_later(_PAUSE_S, self._accept_again, listening)
                return
            if not self._refuse(connection, str(address[0])):
                entering = self._loop.connect_accepted_socket(self._protocol, connection)
                task = self._loop.create_task(self._enter(entering))
                self._entering.add(task)
                task.add_done_callback(self._entering.discard)

    def _accept_again(self, listening: socket.socket) -> None:
        if listening.fileno() >= 0:
            self._loop.add_reader(listening.fileno(), self._accept, listening)

    async def _enter(self, entering: Any) -> None:
        with contextlib.suppress(OSError):  # it has gone
            await entering

    def _refuse(self, connection: socket.socket, peer: str) -> bool:
        """Whether it was refused: there is nothing more to do about this connection."""
        request = _Request()
        try:
            size = connection.recv_into(self._seen, 0, socket.MSG_PEEK | socket.MSG_DONTWAIT)
            request.parser.feed_data(self._seen[:size])
            if not request.has_header:
                return False
            method, path = request.parser.get_method(), httptools.parse_url(request.url).path
        except (OSError, httptools.HttpParserError, httptools.HttpParserUpgrade):
            return False  # whatever is to be said to it, the protocol knows
        refusal = self._gate.refusal(method, path, request.headers, peer)
        if refusal is None or not (request.is_last or refusal.status == HTTPStatus.SERVICE_UNAVAILABLE):
            return False
        is_over = request.is_last and request.is_whole and request.begun == 1
        if not is_over and len(self._lingering) >= self._most_lingering:
            return False
        try:
            # All that came is read: else the kernel would take the answer back when the connection is closed.
            connection.recv_into(self._seen, size, socket.MSG_DONTWAIT)
            answer = self._gate.answer(refusal, path, request.headers, keep=False)
            connection.send(answer, socket.MSG_DONTWAIT | _MORE)  # what follows is the end: one packet
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
            if connection.recv_into(self._seen, 0, socket.MSG_DONTWAIT):
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
