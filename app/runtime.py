"""The life of one server process: start, warm up, serve, drain, stop."""

import asyncio
import logging
from collections.abc import Callable
from enum import Enum

from app.detection import SymmetryDetector
from app.pool import WorkPool
from app.problems import NOT_READY, ProblemError
from app.settings import Settings
from app.warmup import warm_up
from model.errors import CheckpointError

logger = logging.getLogger("prsnet")


class State(Enum):
    """Where the process is in its life; the value is the sentence ``GET /health`` answers with."""

    STARTING = "The service is starting: its weights are being loaded and its kernels warmed up."
    READY = "The service is ready."
    DRAINING = "The service is shutting down; send the request to another instance."
    FAILED = "The service could not load its weights; its log says why."


def load_detector(weights: str) -> SymmetryDetector:
    """The real detector with ``weights``.

    Raises:
        model.errors.CheckpointError: the weights are missing, damaged or do not fit.
    """
    from model.detector import Detector  # here: torch and numba take seconds to import

    return Detector.load(weights)


class Runtime:
    """Settings, worker pool, detector and state, held by the application as ``app.state.runtime``."""

    def __init__(self, settings: Settings, detector: SymmetryDetector | None = None) -> None:
        self.settings = settings
        self.pool = WorkPool(settings.workers, settings.queue)
        self.state = State.STARTING
        self.on_failure: Callable[[], None] = lambda: None
        self._detector = detector
        self._starting: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Load the weights and warm up on a worker, while the event loop already answers."""
        self._starting = asyncio.create_task(self._start())

    async def _start(self) -> None:
        try:
            self._detector = await asyncio.wrap_future(self.pool.submit(self._load))
        except Exception as error:
            expected = isinstance(error, CheckpointError)  # its message says all; anything else is a defect
            logger.error("start-up failed: %s", error, exc_info=not expected)
            self.state = State.FAILED
            self.on_failure()
            return
        if self.state is State.STARTING:
            self.state = State.READY
            logger.info("ready: %s %s", self._detector.name, self._detector.version)

    def _load(self) -> SymmetryDetector:
        detector = self._detector or load_detector(self.settings.weights)
        warm_up(detector)
        return detector

    def drain(self) -> None:
        """From now on ``GET /health`` says 503, to send traffic elsewhere; what comes is still served."""
        self.state = State.DRAINING

    async def stop(self) -> None:
        """Drain, and let the workers finish what runs for up to the deadline."""
        self.drain()
        if self._starting is not None:
            self._starting.cancel()
        self.pool.close(wait=False)
        for _ in range(round(self.settings.deadline_s * 20)):
            if self.pool.admitted == 0:
                return
            await asyncio.sleep(0.05)

    def require_ready(self) -> None:
        """Pass when a request would be served and more are welcome.

        Raises:
            ProblemError: ``not-ready`` (503, with ``Retry-After``).
        """
        if self.state is not State.READY:
            raise ProblemError(NOT_READY, self.state.value, {"Retry-After": "1"})

    @property
    def detector(self) -> SymmetryDetector:
        """The warmed-up detector; it stays in service while draining.

        Raises:
            ProblemError: ``not-ready`` (503, with ``Retry-After``).
        """
        if self._detector is None or self.state in (State.STARTING, State.FAILED):
            raise ProblemError(NOT_READY, self.state.value, {"Retry-After": "1"})
        return self._detector
