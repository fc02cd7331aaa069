"""The process that workers are forked from: it loads weights and kernels once, and never sees an uploaded file.

A fork takes milliseconds and shares what is loaded, where a new process takes seconds and memory of its own. It is
safe because this process has one thread: ``zygote_client`` sets the environment in which libraries start none.

    python -m app.workers.zygote SOCKET LIMITS WEIGHTS

is run by ``zygote_client``; SOCKET is an inherited descriptor, LIMITS the members of ``wire.SandboxLimits`` as
JSON.
"""

import contextlib
import gc
import json
import os
import select
import signal
import socket
import sys
import traceback
from collections.abc import Callable, Sequence
from types import FrameType

from app.detection import SymmetryDetector, load_detector
from app.workers import memory, wire
from app.workers.warmup import warm_up
from app.workers.wire import SandboxLimits
from app.workers.worker import RehearsalError, rehearse, run_worker
from model.errors import CheckpointError
from model.formats import FORMATS


def serve(control: socket.socket, load: Callable[[], SymmetryDetector], limits: SandboxLimits) -> None:
    """Load, say so, then fork a worker for every socket that arrives; returns when the server has gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # they come to the whole group; the server decides when to end
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    gc.disable()  # all that is made now stays
    try:
        detector = load()
        warm_up(detector)
        gc.collect()
        gc.freeze()  # the collector would write to pages that are shared with the workers
        written = rehearse(detector, limits)
    except Exception as error:
        expected = isinstance(error, (CheckpointError, RehearsalError))  # its message says all; else it is a defect
        text = str(error) if expected else traceback.format_exc()
        with contextlib.suppress(ConnectionError):
            control.sendall(wire.json_frame(wire.FAILED, text[-wire.SMALL // 2 :]))
        return
    gc.enable()
    card = {
        "name": detector.name,
        "version": detector.version,
        "sha256": detector.sha256,
        "metadata": dict(detector.metadata),
        "formats": list(FORMATS),
        "threads": len(os.listdir("/proc/self/task")) if os.path.isdir("/proc/self/task") else 1,
    }
    control.sendall(wire.json_frame(wire.LOADED, card))
    children: set[int] = set()
    try:
        with contextlib.suppress(ConnectionError):
            _fork_on_request(control, detector, limits, written, children)
    finally:
        for child in children:
            with contextlib.suppress(ProcessLookupError):
                os.kill(child, signal.SIGKILL)


def _fork_on_request(
    control: socket.socket,
    detector: SymmetryDetector,
    limits: SandboxLimits,
    written: Sequence[memory.Range],
    children: set[int],
) -> None:
    wake, woken = socket.socketpair()
    woken.setblocking(False)
    wake.setblocking(False)
    signal.signal(signal.SIGCHLD, _noted)
    signal.set_wakeup_fd(woken.fileno(), warn_on_full_buffer=False)
    while True:
        ready, _, _ = select.select([control, wake], [], [])
        if wake in ready:
            with contextlib.suppress(BlockingIOError):
                wake.recv(4096)
            for pid, status in _ended(children):
                control.sendall(wire.json_frame(wire.ENDED, [pid, status]))
        if control in ready:
            received = wire.receive_blocking(control)
            if received is None:
                return
            connection = socket.socket(fileno=received[2][0])
            pid = os.fork()
            if pid == 0:
                signal.set_wakeup_fd(-1)
                signal.signal(signal.SIGCHLD, signal.SIG_DFL)
                for other in (control, wake, woken):
                    other.close()
                run_worker(connection, detector, limits, written)
            children.add(pid)
            connection.close()
            control.sendall(wire.json_frame(wire.FORKED, pid))


def _noted(number: int, frame: FrameType | None) -> None:
    """A child ended. The signal's arrival wakes `select` up; there is nothing else to do."""


def _ended(children: set[int]) -> list[tuple[int, int]]:
    """Process ids and exit codes (negative: the signal) of the children that ended."""
    found: list[tuple[int, int]] = []
    while children:
        pid, status = os.waitpid(-1, os.WNOHANG)
        if pid == 0:
            break
        children.discard(pid)
        found.append((pid, os.waitstatus_to_exitcode(status)))
    return found


def main() -> None:
    """Serve with what the command line says."""
    limits = SandboxLimits(**json.loads(sys.argv[2]))

    def load() -> SymmetryDetector:
        from model.detector import use_one_thread

        use_one_thread()
        return load_detector(sys.argv[3])

    with socket.socket(fileno=int(sys.argv[1])) as control:
        serve(control, load, limits)


if __name__ == "__main__":
    main()
