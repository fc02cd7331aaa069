"""Sends a file in pieces with time limits: a client that does not read occupies memory only for a short time."""

import asyncio
import re
from collections.abc import Callable
from pathlib import PurePath
from urllib.parse import quote

from starlette.requests import ClientDisconnect
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

_PIECE = 256 * 1024


def disposition(filename: str, ending: str) -> str:
    """The header Content-Disposition for a file named after the one that came (RFC 6266)."""
    name = PurePath(filename).stem + ending
    plain = re.sub(r"[^A-Za-z0-9._-]", "_", name)
    header = f'attachment; filename="{plain}"'
    return header if plain == name else f"{header}; filename*=UTF-8''{quote(name, safe='')}"


class Attachment(Response):
    """A body in parts. The client must take each piece within ``stall_s`` and all of it within ``seconds``.

    ``on_end`` is called when it is over, however it ended.
    """

    def __init__(
        self,
        parts: list[bytes],
        headers: dict[str, str],
        media_type: str,
        *,
        stall_s: float,
        seconds: float,
        on_end: Callable[[], None],
    ) -> None:
        length = str(sum(map(len, parts)))
        super().__init__(None, headers={**headers, "Content-Length": length}, media_type=media_type)
        self._parts = parts
        self._stall_s = stall_s
        self._seconds = seconds
        self._on_end = on_end

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send it (ASGI).

        Raises:
            ClientDisconnect: the client takes too long, and the server cannot break the connection.
        """
        try:
            await send({"type": "http.response.start", "status": self.status_code, "headers": self.raw_headers})
            async with asyncio.timeout(self._seconds):
                for part in self._parts:
                    view = memoryview(part)
                    for at in range(0, len(view), _PIECE):
                        piece = bytes(view[at : at + _PIECE])
                        async with asyncio.timeout(self._stall_s):
                            await send({"type": "http.response.body", "body": piece, "more_body": True})
            await send({"type": "http.response.body", "body": b"", "more_body": False})
        except TimeoutError:
            # Nobody reads, which is no defect of anybody here: break the connection, and let the request end.
            scope["problem"] = "client-left"
            if "abort" in scope:
                scope["abort"]()
                await asyncio.sleep(0)
            else:
                raise ClientDisconnect from None
        finally:
            self._parts = []
            self._on_end()
