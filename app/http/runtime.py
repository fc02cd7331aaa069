"""The life of one server process: start, serve, drain, stop."""

import asyncio
import logging
from collections.abc import Callable
from enum import Enum

from app.http.answer_cache import AnswerCache
from app.http.gate import Gate
from app.http.metrics import Metrics
from app.problems import NOT_READY, ProblemError
from app.settings import Settings
from app.workers.pool import WorkerPool
from app.workers.zygote_client import Card, Launch, StartError, launcher

logger = logging.getLogger("prsnet")


class State(Enum):
    """Where the process is in its life; the value is the sentence ``GET /health`` answers with."""

    STARTING = "The service is starting: its weights are being loaded and its kernels warmed up."
    READY = "The service is ready."
    DRAINING = "The service is shutting down; send the request to another instance."
    FAILED = "The service could not load its weights; its log says why."


_NO_WORKER = "All workers have died and are being replaced; send the request to another instance."


class Runtime:
    """Settings, worker pool and state, held by the application as ``app.state.runtime``."""

    def __init__(self, settings: Settings, launch: Launch | None = None) -> None:
        self.settings = settings
        self.pool = WorkerPool(settings, launch or launcher(settings.weights))
        self.state = State.STARTING
        self.sending_bytes = 0
        self.metrics = Metrics()
        self.gate = Gate(settings, self.pool, self.metrics)
        self.cache = AnswerCache(settings.cache_bytes)
        self.pool.on_restart = self._on_restart
        self._watch()
        self.on_failure: Callable[[], None] = lambda: None
        self._starting: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Load the weights and start the workers, while the event loop already answers."""
        self._starting = asyncio.create_task(self._start())

    async def _start(self) -> None:
        try:
            card = await self.pool.start()
        except Exception as error:
            logger.error("start-up failed: %s", error, exc_info=not isinstance(error, StartError))
            self.state = State.FAILED
            self.on_failure()
            return
        if self.state is State.STARTING:
            self.state = State.READY
            self.metrics.set_model(card.name, card.version, card.sha256)
            logger.info("ready: %s %s", card.name, card.version)

    def _on_restart(self, reason: str) -> None:
        self.metrics.count_restart(reason)
        if reason in ("untrusted", "renewed"):  # what a worker that was taken over has said before is not repeated
            self.cache.clear()

    def _watch(self) -> None:
        watch, pool = self.metrics.watch, self.pool
        watch("uploading", "Uploads being received.", lambda: len(self.gate.slots))
        watch("sending_bytes", "Bytes of meshes on their way to clients.", lambda: self.sending_bytes)
        watch("jobs_admitted", "Requests in the queue or with a worker.", lambda: pool.admitted)
        watch("jobs_running", "Jobs being worked on.", lambda: pool.running)
        watch("queue_depth", "Requests that wait for a worker.", lambda: pool.admitted - pool.running)
        watch("queue_capacity", "Requests that may wait for a worker.", lambda: self.settings.queue)
        watch("workers_live", "Workers there are, the spare one included.", lambda: pool.live)
        watch("cache_bytes", "Bytes of answers kept for files that are sent again.", lambda: self.cache.size)
        watch("cache_hits", "Requests answered with a kept answer since the start.", lambda: self.cache.hits)
        watch("cache_misses", "Requests for which none was kept since the start.", lambda: self.cache.misses)
        watch("ready", "1 when requests are welcome.", lambda: self.state is State.READY and pool.live > 0)

    def drain(self) -> None:
        """From now on ``GET /health`` says 503, to send traffic elsewhere; what comes is still served."""
        self.state = State.DRAINING

    async def stop(self) -> None:
        """Drain, let the workers finish what runs for up to the deadline, and end them."""
        self.drain()
        if self._starting is not None:
            self._starting.cancel()
        for _ in range(round(self.settings.deadline_s * 20)):
            if self.pool.admitted == 0:
                break
            await asyncio.sleep(0.05)
        await self.pool.close()

    def require_ready(self) -> None:
        """Pass when a request would be served and more are welcome.

        Raises:
            ProblemError: ``not-ready`` (503, with ``Retry-After``).
        """
        if self.state is not State.READY:
            raise ProblemError(NOT_READY, self.state.value, {"Retry-After": "1"})
        if self.pool.live == 0:
            raise ProblemError(NOT_READY, _NO_WORKER, {"Retry-After": "1"})

    @property
    def card(self) -> Card:
        """What is served; it stays in service while draining.

        Raises:
            ProblemError: ``not-ready`` (503, with ``Retry-After``).
        """
        if self.pool.card is None or self.state in (State.STARTING, State.FAILED):
            raise ProblemError(NOT_READY, self.state.value, {"Retry-After": "1"})
        return self.pool.card
