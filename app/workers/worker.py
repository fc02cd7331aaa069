"""What a worker does: enter the sandbox, warm up, then one job after the other until the server hangs up."""

import contextlib
import json
import os
import socket
import traceback
from typing import NoReturn

from app.detection import MeshLimits, Options, SymmetryDetector, parse_and_detect
from app.workers import sandbox, wire
from app.workers.jobs import perform
from app.workers.warmup import sample_files
from model.errors import MeshError

_LONGEST_TRACE = 8000
_NO_MEMORY = wire.frame(wire.NO_MEMORY)  # made while there is memory for it


def run_worker(connection: socket.socket, detector: SymmetryDetector, limits: wire.SandboxLimits) -> NoReturn:
    """Serve jobs until the server has gone, or something went wrong and was reported to it; then end the process."""
    code = 1
    try:
        _mute()
        _run(connection, detector, limits)
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


def _run(connection: socket.socket, detector: SymmetryDetector, limits: wire.SandboxLimits) -> None:
    """Serve jobs; returns when the server has gone, or when memory ran out and the process should not go on."""
    os.nice(limits.nice)
    sandbox.raise_oom_score()
    sandbox.limit_resources(limits.memory_bytes, strict=limits.sandbox)
    if limits.sandbox:
        sandbox.filter_system_calls()
    # Inside the sandbox, so that what they break breaks here; and once in this process, so that the pages it shares
    # with the zygote until it writes to them are its own before a request waits for it.
    name, data = sample_files()[0]
    parse_and_detect(detector, data, name, Options(), MeshLimits())
    connection.sendall(wire.frame(wire.READY))
    while _serve_one(connection, detector):
        pass


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
