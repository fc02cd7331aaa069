"""A detector that finds one plane and can be made to wait or fail, and an application served in memory.

The detector runs in workers, which are forked from a zygote, which is forked from the test: what the two sides share
is memory and locks that survive a fork.
"""

import asyncio
import functools
import gc
import mmap
import multiprocessing
import os
import pickle
import socket
import time
import traceback
import warnings
from collections.abc import AsyncGenerator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from app.http.main import create_app
from app.http.runtime import Runtime, State
from app.settings import Settings
from app.workers import zygote
from app.workers.warmup import warm_up
from app.workers.wire import SandboxLimits
from model.detection import Axis, Detection, Plane, Rejected

DATA = Path(__file__).parents[1] / "data"
CONTEXT = multiprocessing.get_context("fork")


class Gate:
    """An event across forks that does not mind when one who waits is killed, as multiprocessing's does."""

    def __init__(self) -> None:
        self._open = mmap.mmap(-1, 1)
        self.set()

    def set(self) -> None:
        self._open[0] = 1

    def clear(self) -> None:
        self._open[0] = 0

    def wait(self, seconds: float) -> bool:
        end = time.monotonic() + seconds
        while not self._open[0] and time.monotonic() < end:
            time.sleep(0.002)
        return bool(self._open[0])


class FakeDetector:
    """Claims that every mesh mirrors at the middle of its bounds along x, and turns there about z and y.

    ``failure``, ``warm_failure``, ``action`` and ``symmetry_error`` are what they are when the application starts, and
    ``failure`` and ``symmetry_error`` can be changed later through ``tell``.
    """

    name = "fake"
    version = "0"
    sha256 = "f" * 64

    def __init__(self) -> None:
        self.metadata: dict[str, Any] = {"recipe": "none"}
        self.gate = Gate()
        self.warm_gate = Gate()
        self.warm_failure: Exception | None = None
        self.failure: Exception | None = None
        self.symmetry_error = 1.25e-9
        self.action: Callable[[], None] = lambda: None
        self._told = CONTEXT.SimpleQueue()
        self._reported = CONTEXT.SimpleQueue()
        self._calls: list[dict[str, Any]] = []
        self._warm = 12  # faces of the box that workers warm up on

    @property
    def calls(self) -> list[dict[str, Any]]:
        """What workers were asked for, their warm-up left out."""
        while not self._reported.empty():
            self._calls.append(self._reported.get())
        return self._calls

    def tell(self, **attributes: Any) -> None:
        """Change attributes in the one worker that takes the next job."""
        self._told.put(pickle.dumps(attributes))

    def warm_up(self) -> None:
        assert self.warm_gate.wait(20)
        if self.warm_failure:
            raise self.warm_failure

    def detect(
        self,
        mesh: Any,
        *,
        mode: str = "full",
        max_error: float = 4e-4,
        level: str = "auto",
        tolerance: float | None = None,
    ) -> Detection:
        if len(mesh.faces) != self._warm:
            call = {"mode": mode, "max_error": max_error, "level": level, "tolerance": tolerance}
            self._reported.put(call | {"pid": os.getpid()})
            while not self._told.empty():
                for name, value in pickle.loads(self._told.get()).items():
                    setattr(self, name, value)
            assert self.gate.wait(20)
            self.action()
            if self.failure:
                raise self.failure
        center = np.asarray(mesh.bounds).mean(axis=0)
        found = {
            "point": center,
            "symmetry_error": self.symmetry_error if len(mesh.faces) != self._warm else 0.0,
            "rms_distance": 3.5e-5,
            "max_distance": 9.0e-5,
            "coverage": 1.0,
            "exact": True,
        }
        normal = np.array([1.0, -0.0, -0.0])
        plane = Plane(normal=normal, offset=-float(center[0]), continuous=False, **found)
        up, forward = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])
        axes = [
            Axis(direction=up, order=2, continuous=False, **found),
            Axis(direction=forward, order=None, continuous=True, **found),
        ]
        rejected = [
            Rejected("plane", 2.6e-3, "not_symmetric", normal=forward, offset=0.5),
            Rejected("axis", 2.7e-3, "not_continuous", direction=forward, point=center),
        ]
        timings = {"voxelize": 0.1, "infer": 0.2, "refine": 0.0, "validate": 0.4, "total": 0.75}
        return Detection([plane], axes, "Cs", center, 1.5, mesh, timings, ["a warning"], rejected)


@functools.cache
def _warm() -> None:
    """What a zygote does before it forks workers, once in this process: its forks find it done."""
    warm_up(FakeDetector())
    gc.collect()
    gc.freeze()


def forked(detector: Any) -> Callable[[SandboxLimits], tuple[socket.socket, Callable[[], None]]]:
    """A launcher of zygotes that serve ``detector``, forked from this process."""

    former = list[socket.socket]()

    def launch(limits: SandboxLimits) -> tuple[socket.socket, Callable[[], None]]:
        _warm()
        ours, theirs = socket.socketpair()
        former.append(ours)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # newer Pythons warn of threads, of which the child uses none
            pid = os.fork()
        if pid == 0:
            try:
                for one in former:  # as long as anybody has them open, the zygotes at their other ends do not end
                    one.close()
                zygote.serve(theirs, lambda: detector, limits)
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(0)
        theirs.close()

        def end() -> None:
            for _ in range(2000):  # it ends by itself when its socket is closed, and ends its children first
                if os.waitpid(pid, os.WNOHANG)[0]:
                    return
                time.sleep(0.005)
            raise AssertionError("the zygote does not end")

        return ours, end

    return launch


Serving = Callable[..., AbstractAsyncContextManager[tuple[httpx.AsyncClient, Runtime]]]


@asynccontextmanager
async def serve_in_memory(
    detector: Any, *, wait: bool = True, **settings: Any
) -> AsyncGenerator[tuple[httpx.AsyncClient, Runtime], None]:
    app = create_app(
        Settings(**{"workers": 1, "queue": 1, "deadline_s": 20.0, "cache_bytes": 0, **settings}), forked(detector)
    )
    runtime: Runtime = app.state.runtime
    transport = httpx.ASGITransport(app, raise_app_exceptions=False)
    async with (
        app.router.lifespan_context(app),
        httpx.AsyncClient(transport=transport, base_url="http://t") as client,
    ):
        while wait and runtime.state is State.STARTING:
            await asyncio.sleep(0.005)
        yield client, runtime
