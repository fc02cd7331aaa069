"""The server's client of the zygote: starts it, requests workers, receives how they ended."""

import asyncio
import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from app.threads import ONE_THREAD
from app.workers import wire
from app.workers.wire import SandboxLimits

# What of the environment the processes that parse may know: how to find and run code. No key, no token, no setting.
_HARMLESS = re.compile(
    r"PATH|HOME|LANG|LC_\w+|TZ|TMPDIR|XDG_CACHE_HOME|LD_LIBRARY_PATH|PYTHON(?!PATH)\w*|NUMBA_\w+|MKL_\w+|OMP_\w+"
    r"|VIRTUAL_ENV|SYSTEMROOT"
)
_LARGEST_CARD = 16 << 20
_FORK_S, _WORKER_START_S = 5.0, 30.0


class StartError(Exception):
    """The zygote could not load, or no worker starts; the message says why."""


@dataclass(frozen=True, slots=True)
class Card:
    """What the zygote has loaded."""

    name: str
    version: str
    sha256: str
    metadata: dict[str, Any]
    formats: list[str]
    threads: int


Launch: TypeAlias = Callable[[SandboxLimits], tuple[socket.socket, Callable[[], None]]]
"""Starts a zygote: the server's end of its socket, and what ends and reaps it."""


def launcher(weights: str) -> Launch:
    """Starts zygotes that serve ``weights``, each in a new interpreter."""

    def launch(limits: SandboxLimits) -> tuple[socket.socket, Callable[[], None]]:
        ours, theirs = socket.socketpair()
        root = str(Path(__file__).parents[2])
        path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH")]))
        command = [sys.executable, *(f"-W{option}" for option in sys.warnoptions), "-m", "app.workers.zygote"]
        with theirs:
            process = subprocess.Popen(
                [*command, str(theirs.fileno()), json.dumps(asdict(limits)), weights],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                env=_environment() | ONE_THREAD | {"PYTHONPATH": path},
                process_group=0,  # a Ctrl-C is the server's to handle; in its session, where `nice` counts between them
            )

        def end() -> None:
            process.kill()
            process.wait()

        return ours, end

    return launch


def _environment() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if _HARMLESS.fullmatch(name)}


@dataclass(eq=False, slots=True)
class Worker:
    """One worker process: its id, the socket to it, and what it was forked by."""

    pid: int
    connection: socket.socket
    origin: "ZygoteClient"
    jobs: int = 0
    tenant: str = ""
    ended: "asyncio.Future[int]" = field(default_factory=lambda: asyncio.get_running_loop().create_future())
    _handle: int | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        # A handle stays this process's even when its id is given to another one.
        with contextlib.suppress(OSError, AttributeError):
            self._handle = os.pidfd_open(self.pid)

    def silent(self) -> bool:
        """Whether it is there, not stopped, and has nothing to say, as it should when it has no job."""
        if self.is_stopped():
            return False
        try:
            self.connection.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT)
        except BlockingIOError:
            return True
        except OSError:
            pass
        return False

    def is_stopped(self) -> bool:
        """Whether somebody stopped it by a signal: it goes on when they say so, or never."""
        with contextlib.suppress(OSError, IndexError), open(f"/proc/{self.pid}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] in "Tt"
        return False

    def end(self) -> None:
        """End the process now, whatever it does. Who waits for its answer finds that the other end has gone."""
        with contextlib.suppress(ProcessLookupError):
            if self._handle is not None:
                signal.pidfd_send_signal(self._handle, signal.SIGKILL)
            elif not self.ended.done():
                os.kill(self.pid, signal.SIGKILL)

    def kill(self) -> None:
        """End the process, and hang up."""
        self.end()
        self.close()

    def close(self) -> None:
        """Hang up: it ends when its job is done."""
        self.connection.close()
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None


class ZygoteClient:
    """One zygote. ``on_worker_end`` and ``on_end`` are called from the event loop."""

    def __init__(self, launch: Launch, limits: SandboxLimits) -> None:
        self._launch = launch
        self._limits = limits
        self._workers: dict[int, Worker] = {}
        self._asked: deque[tuple[socket.socket, asyncio.Future[Worker]]] = deque()
        self._listener: asyncio.Task[None] | None = None
        self._control: socket.socket | None = None
        self._end: Callable[[], None] = lambda: None
        self.on_worker_end: Callable[[Worker], None] = lambda _: None
        self.on_end: Callable[[], None] = lambda: None

    @property
    def alive(self) -> bool:
        """Whether it can be asked for workers."""
        return self._listener is not None and not self._listener.done()

    async def start(self) -> Card:
        """Launch the zygote and wait until it has loaded.

        Raises:
            StartError: it did not.
        """
        self._control, self._end = self._launch(self._limits)
        self._control.setblocking(False)
        try:
            kind, payload = await wire.receive(self._control, _LARGEST_CARD)
        except (EOFError, OSError, wire.WireError) as error:
            raise StartError("the process that loads the weights ended") from error
        if kind == wire.FAILED:
            message = str(json.loads(payload))
            raise StartError(message)
        self._listener = asyncio.create_task(self._listen(self._control))
        return Card(**json.loads(payload))

    async def spawn(self) -> Worker:
        """A new worker, warmed up and inside its limits.

        Raises:
            OSError, EOFError, TimeoutError, wire.WireError: it did not come.
        """
        if not self.alive or self._control is None:
            raise EOFError
        ours, theirs = socket.socketpair()
        ours.setblocking(False)
        future: asyncio.Future[Worker] = asyncio.get_running_loop().create_future()
        self._asked.append((ours, future))
        with theirs:
            socket.send_fds(self._control, [wire.frame(wire.FORK)], [theirs.fileno()])
        try:
            async with asyncio.timeout(_FORK_S):
                worker = await future
        except TimeoutError:  # it hangs: nobody need ask it again
            await self.close()
            raise
        try:
            async with asyncio.timeout(_WORKER_START_S):
                kind, payload = await wire.receive(ours)
            if kind != wire.READY:
                raise wire.WireError(f"a worker that is not ready:\n{payload.decode(errors='replace')}")
        except BaseException:
            worker.kill()
            raise
        return worker

    async def _listen(self, control: socket.socket) -> None:
        try:
            while True:
                kind, payload = await wire.receive(control)
                if kind == wire.FORKED:
                    connection, future = self._asked.popleft()
                    worker = self._workers[int(payload)] = Worker(int(payload), connection, self)
                    if future.cancelled():
                        worker.kill()
                    else:
                        future.set_result(worker)
                elif kind == wire.ENDED:
                    pid, code = json.loads(payload)
                    worker = self._workers.pop(pid)
                    worker.ended.set_result(code)
                    self.on_worker_end(worker)
        except (EOFError, OSError, wire.WireError):
            pass
        finally:
            for connection, future in self._asked:
                connection.close()
                if not future.done():
                    future.set_exception(EOFError())
            self._asked.clear()
            asyncio.get_running_loop().call_soon(self.on_end)

    async def close(self) -> None:
        """End the zygote, and with it whatever workers it still has."""
        self.on_end = lambda: None
        if self._listener is not None:
            self._listener.cancel()
            await asyncio.wait({self._listener})
        if self._control is not None:
            self._control.close()
        await asyncio.to_thread(self._end)
