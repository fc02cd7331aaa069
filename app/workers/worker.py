"""What a worker does: enter the sandbox, then one job after the other until the server hangs up."""

import contextlib
import json
import os
import select
import signal
import socket
import traceback
from collections.abc import Sequence
from typing import NoReturn

from app.detection import MeshLimits, Options, SymmetryDetector, parse_and_detect
from app.workers import memory, sandbox, wire
from app.workers.jobs import perform
from app.workers.warmup import sample_files
from model.errors import MeshError

_LONGEST_TRACE = 8000
_REHEARSAL_S = 60.0
_NO_MEMORY = wire.frame(wire.NO_MEMORY)  # made while there is memory for it


class RehearsalError(Exception):
    """A worker cannot do inside the sandbox what it is for; the message says what went wrong."""


def rehearse(detector: SymmetryDetector, limits: wire.SandboxLimits) -> list[memory.Range]:
    """Fork a worker that does one job inside the sandbox and ends: what breaks there breaks before there are requests.

    Returns the memory that it has written to, which every other worker will write to as well.

    Raises:
        RehearsalError: it could not.
    """
    shared = memory.writable_ranges()
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        _rehearse(writing, detector, limits, shared)
    os.close(writing)
    try:
        with open(reading, "rb") as pipe:
            answer = b""
            while select.select([pipe], [], [], _REHEARSAL_S)[0]:
                piece = os.read(pipe.fileno(), 1 << 16)
                if not piece:
                    break
                answer += piece
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
    if not answer:
        raise RehearsalError("a worker that tried out the sandbox hung, or ended without a word")
    kind, payload = answer[:1], json.loads(answer[1:])
    if kind != wire.READY:
        raise RehearsalError(payload)
    return [(first, end) for first, end in payload]


def _rehearse(
    writing: int, detector: SymmetryDetector, limits: wire.SandboxLimits, shared: Sequence[memory.Range]
) -> NoReturn:
    try:
        _mute()
        pagemap = memory.open_pagemap()
        try:
            _enter(limits)
        except OSError as error:
            raise RehearsalError(
                f"a worker cannot be locked in here (it needs /proc): {error}; PRSNET_SANDBOX=false serves without"
            ) from error
        name, data = sample_files()[0]
        parse_and_detect(detector, data, name, Options(), MeshLimits())
        answer = wire.READY + json.dumps(memory.written_ranges(pagemap, shared)).encode()
    except BaseException as error:
        text = str(error) if isinstance(error, RehearsalError) else traceback.format_exc()[-_LONGEST_TRACE:]
        answer = wire.DEFECT + json.dumps(text).encode()
    with contextlib.suppress(BaseException):
        while answer:
            answer = answer[os.write(writing, answer) :]
    os._exit(0)


def run_worker(
    connection: socket.socket,
    detector: SymmetryDetector,
    limits: wire.SandboxLimits,
    written: Sequence[memory.Range] = (),
) -> NoReturn:
    """Serve jobs until the server has gone, or something went wrong and was reported to it; then end the process.

    ``written`` is what `rehearse` returned.
    """
    code = 1
    try:
        _mute()
        _enter(limits)
        memory.populate(written)
        connection.sendall(wire.frame(wire.READY))
        while _serve_one(connection, detector):
            pass
        code = 0
    except BaseException:
        with contextlib.suppress(BaseException):
            connection.sendall(wire.json_frame(wire.DEFECT, traceback.format_exc()[-_LONGEST_TRACE:]))
    finally:
        os._exit(code)  # without the exit handlers of the process it was forked from


def _mute() -> None:
    """What libraries print may quote a file; what the server should know is sent to it."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in (0, 1, 2):
        os.dup2(nowhere, descriptor)
    os.close(nowhere)


def _enter(limits: wire.SandboxLimits) -> None:
    os.nice(limits.nice)
    sandbox.raise_oom_score()
    sandbox.limit_resources(limits.memory_bytes, strict=limits.sandbox)
    if limits.sandbox:
        sandbox.filter_system_calls()


def _serve_one(connection: socket.socket, detector: SymmetryDetector) -> bool:
    """Answer one job; False when it was the last."""
    try:
        received = wire.receive_blocking(connection)
        if received is None:
            return False
        job = wire.Job(**json.loads(received[1]))
        try:
            data = wire.receive_file(connection, job, received[2])
        finally:
            for descriptor in received[2]:
                os.close(descriptor)
        sandbox.limit_cpu(job.cpu_s)
        for frame in _answer(connection, detector, job, data):
            connection.sendall(frame)
    except (EOFError, ConnectionError):
        return False
    except MemoryError:
        with contextlib.suppress(ConnectionError):
            connection.sendall(_NO_MEMORY)
        return False
    return True


def _answer(connection: socket.socket, detector: SymmetryDetector, job: wire.Job, data: bytes) -> list[bytes]:
    def parsed() -> None:
        connection.sendall(wire.frame(wire.PARSED))

    try:
        text, body = perform(detector, job, data, parsed)
        frames = [wire.frame(wire.ANSWER, text)]
        # The body is not copied: it may be large.
        return frames if body is None else [*frames, wire.head(wire.GEOMETRY, len(body)), body]
    except MeshError as error:
        return [wire.json_frame(wire.MESH_ERROR, [type(error).__name__, str(error)])]
    except MemoryError:
        raise
    except Exception as error:
        if "can't allocate memory" in str(error):  # torch's way to say MemoryError
            raise MemoryError from error
        return [wire.json_frame(wire.DEFECT, traceback.format_exc()[-_LONGEST_TRACE:])]
