"""A detector that finds one plane and can be made to wait or fail, and an application served in memory."""

import asyncio
import threading
from collections.abc import AsyncGenerator, Callable
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from app.main import create_app
from app.runtime import Runtime, State
from app.settings import Settings
from model.detection import Axis, Detection, Plane, Rejected

DATA = Path(__file__).parents[1] / "data"


class FakeDetector:
    """Claims that every mesh mirrors at the middle of its bounds along x, and turns there about z and y."""

    name = "fake"
    version = "0"
    sha256 = "f" * 64

    def __init__(self) -> None:
        self.metadata: dict[str, Any] = {"recipe": "none"}
        self.gate = threading.Event()
        self.gate.set()
        self.warm_gate = threading.Event()
        self.warm_gate.set()
        self.calls: list[dict[str, Any]] = []
        self.failure: Exception | None = None
        self.warm_failure: Exception | None = None
        self.symmetry_error = 1.25e-9

    def warm_up(self) -> None:
        assert self.warm_gate.wait(20)
        if self.warm_failure:
            raise self.warm_failure

    def detect(self, mesh: Any, *, mode: str = "full", max_error: float = 4e-4) -> Detection:
        self.calls.append({"mode": mode, "max_error": max_error, "thread": threading.current_thread()})
        assert self.gate.wait(20)
        if self.failure:
            raise self.failure
        center = np.asarray(mesh.bounds).mean(axis=0)
        found = {
            "point": center,
            "symmetry_error": self.symmetry_error,
            "rms_distance": 3.5e-5,
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


Serving = Callable[..., AbstractAsyncContextManager[tuple[httpx.AsyncClient, Runtime]]]


@asynccontextmanager
async def serve_in_memory(
    detector: Any, *, wait: bool = True, **settings: Any
) -> AsyncGenerator[tuple[httpx.AsyncClient, Runtime], None]:
    app = create_app(Settings(**{"workers": 1, "queue": 1, "deadline_s": 20.0, **settings}), detector)
    runtime: Runtime = app.state.runtime
    transport = httpx.ASGITransport(app, raise_app_exceptions=False)
    async with (
        app.router.lifespan_context(app),
        httpx.AsyncClient(transport=transport, base_url="http://t") as client,
    ):
        while wait and runtime.state is State.STARTING:
            await asyncio.sleep(0.005)
        yield client, runtime
