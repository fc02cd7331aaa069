"""Frames between server, zygote and workers: one byte of kind, four of length, then the payload.

A frame's length is checked against a limit before anything is allocated, because a worker that parsed a hostile file
may send anything.
"""

import asyncio
import json
import os
import socket
import struct
from dataclasses import dataclass, field, fields
from typing import Any, Literal

from app.schemas import Include, LevelName, Mode

_HEAD = struct.Struct("!cI")

# Server to zygote, with a socket attached; zygote to server.
FORK, LOADED, FAILED, FORKED, ENDED = b"K", b"L", b"F", b"P", b"X"
# Server to worker; worker to server.
JOB, READY, PARSED, ANSWER, GEOMETRY = b"J", b"R", b"p", b"A", b"G"
MESH_ERROR, NO_MEMORY, DEFECT = b"E", b"M", b"D"

SMALL = 64 * 1024
"""Limit of every frame but an answer and the geometry that may follow it, in bytes."""


class WireError(Exception):
    """The other side sent something that is no frame, or too large a one."""


@dataclass(frozen=True, slots=True)
class Job:
    """One file to work on. ``size`` bytes of it follow the frame, or are in the file whose descriptor came with it.

    With ``geometry`` the answer is followed by a frame of kind `GEOMETRY`, the body of a file of that format.
    ``plane`` (unit normal and offset) is for completing and halving, ``symmetrize`` for the first, ``positive`` (which
    side is kept) for the second. ``line`` (unit direction and point of an axis), ``order`` and ``start`` are for
    sectors, ``capped`` for them and for halves. ``parts`` are name and size of every file where several came, the mesh
    and what it refers to, one after the other in the bytes.
    """

    filename: str
    mode: Mode
    max_error: float
    include: list[Include]
    max_vertices: int
    max_faces: int
    max_nodes: int
    max_unpacked_bytes: int
    cpu_s: float
    size: int
    transport: Literal["inline", "descriptor"]
    task: Literal["detect", "complete", "halve", "sector", "align"] = "detect"
    geometry: str | None = None
    plane: list[float] | None = None
    symmetrize: bool = False
    positive: bool = True
    capped: bool = False
    line: list[float] | None = None
    order: int | None = None
    start: list[float] | None = None
    max_answer_bytes: int = 0
    level: LevelName = "auto"
    tolerance: float | None = None
    parts: list[list[Any]] = field(default_factory=list[list[Any]])

    @property
    def members(self) -> dict[str, Any]:
        """All of it by name, as JSON has it."""
        return {name: getattr(self, name) for name in _MEMBERS}

    def files(self, data: bytes) -> tuple[bytes, dict[str, bytes]]:
        """The mesh, and by name the other files that came with it."""
        if not self.parts:
            return data, {}
        found: dict[str, bytes] = {}
        at = 0
        for name, size in self.parts:
            found[name] = data[at : at + size]
            at += size
        return found.pop(self.filename), found


_MEMBERS = tuple(member.name for member in fields(Job))


@dataclass(frozen=True, slots=True)
class SandboxLimits:
    """What a worker may use: see the settings of the same names."""

    memory_bytes: int
    sandbox: bool
    nice: int


def frame(kind: bytes, payload: bytes = b"") -> bytes:
    """The bytes of a frame."""
    return head(kind, len(payload)) + payload


def head(kind: bytes, size: int) -> bytes:
    """What stands before ``size`` bytes of payload."""
    return _HEAD.pack(kind, size)


def json_frame(kind: bytes, value: Any) -> bytes:
    """A frame whose payload is JSON."""
    return frame(kind, json.dumps(value).encode())


def parse_head(head: bytes, limit: int) -> tuple[bytes, int]:
    """Kind and length of a frame.

    Raises:
        WireError: the payload is longer than ``limit``.
    """
    kind, size = _HEAD.unpack(head)
    if size > limit:
        raise WireError(f"a frame of {size} bytes, more than {limit}")
    return kind, size


# The server's side: never blocks.


async def receive(connection: socket.socket, limit: int = SMALL) -> tuple[bytes, bytes]:
    """The next frame; ``limit`` bounds its payload.

    Raises:
        WireError: the frame is too large.
        EOFError, OSError: the other side ended.
    """
    kind, size = parse_head(await _exactly(connection, _HEAD.size), limit)
    return kind, await _exactly(connection, size)


async def _exactly(connection: socket.socket, size: int) -> bytes:
    buffer = bytearray(size)
    view, at = memoryview(buffer), 0
    while at < size:
        received = await asyncio.get_running_loop().sock_recv_into(connection, view[at:])
        if not received:
            raise EOFError
        at += received
    return bytes(buffer)


async def send_job(connection: socket.socket, job: Job, data: bytes | int) -> None:
    """A job with its file: bytes, or the descriptor of an open one."""
    head = json_frame(JOB, job.members)
    if isinstance(data, int):
        # Far smaller than a socket's buffer, which is empty, because the worker is idle: this does not block.
        if socket.send_fds(connection, [head], [data]) != len(head):
            raise OSError("the worker does not take the job")
        return
    loop = asyncio.get_running_loop()
    await loop.sock_sendall(connection, head)
    await loop.sock_sendall(connection, data)  # by itself: it is not copied


# The other side: blocks.


def receive_blocking(connection: socket.socket) -> tuple[bytes, bytes, list[int]] | None:
    """The next frame with the descriptors attached to it, or None when the server has gone.

    Raises:
        WireError: the frame is too large.
        EOFError: the server ended within a frame.
    """
    head, descriptors, _, _ = socket.recv_fds(connection, _HEAD.size, 4)
    if not head:
        return None
    while len(head) < _HEAD.size:
        head += _read(connection, _HEAD.size - len(head))
    kind, size = parse_head(head, SMALL)
    return kind, _read(connection, size), descriptors


def receive_file(connection: socket.socket, job: Job, descriptors: list[int]) -> bytes:
    """The bytes of the file a job is about."""
    if job.transport == "inline":
        return _read(connection, job.size)
    parts: list[bytes] = []
    at = 0
    while at < job.size and (part := os.pread(descriptors[0], job.size - at, at)):
        parts.append(part)
        at += len(part)
    return b"".join(parts)


def _read(connection: socket.socket, size: int) -> bytes:
    data = connection.recv(size, socket.MSG_WAITALL)  # at once, into what is returned: a file is not copied
    while len(data) < size:  # a signal came in between
        more = connection.recv(size - len(data), socket.MSG_WAITALL)
        if not more:
            raise EOFError
        data += more
    return data
