"""What a worker does: warm up, put up the walls, then one job after the other until the server hangs up."""

import json
import os
import socket
import sys
import traceback

from app.detection import MeshLimits, Options, SymmetryDetector, parse_and_detect
from app.schemas import to_json
from app.warmup import sample_files
from app.workers import sandbox, wire
from model.errors import MeshError

_LONGEST_TRACE = 8000


def run(connection: socket.socket, detector: SymmetryDetector, walls: wire.Walls) -> None:
    """Serve jobs; returns when the server has gone, or when memory ran out and the process should not go on."""
    os.nice(walls.nice)
    sandbox.be_killed_first()
    sandbox.limit_resources(walls.memory_bytes)
    if walls.sandbox and sandbox.available():
        sandbox.filter_system_calls()
    # Inside of the walls, so that what they break breaks here; and once in this process, so that the pages it shares
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
    except (EOFError, ConnectionError):
        return False
    sandbox.limit_cpu(job.cpu_s)
    try:
        answer = _answer(connection, detector, job, data)
    except MemoryError:
        answer = wire.frame(wire.NO_MEMORY)
    try:
        connection.sendall(answer)
    except ConnectionError:
        return False
    return answer[:1] != wire.NO_MEMORY


def _answer(connection: socket.socket, detector: SymmetryDetector, job: wire.Job, data: bytes) -> bytes:
    options = Options(job.mode, job.max_error, job.include)
    limits = MeshLimits(job.max_vertices, job.max_faces, job.max_nodes, job.max_unpacked_bytes)

    def parsed() -> None:
        connection.sendall(wire.frame(wire.PARSED))

    try:
        response = parse_and_detect(detector, data, job.filename, options, limits, parsed)
        return wire.frame(wire.ANSWER, to_json(response, options.include))
    except MeshError as error:
        return wire.json_frame(wire.MESH_ERROR, [type(error).__name__, str(error)])
    except MemoryError:
        raise
    except Exception as error:
        if "can't allocate memory" in str(error):  # torch's way to say MemoryError
            raise MemoryError from error
        return wire.json_frame(wire.DEFECT, traceback.format_exc()[-_LONGEST_TRACE:])


def die(message: str) -> None:
    """End the process at once, as a forked one must: without the exit handlers of the one it came from."""
    if message:
        print(message, file=sys.stderr, flush=True)
    os._exit(1 if message else 0)
