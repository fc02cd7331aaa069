"""The only place where meshes are parsed and computed on: a bounded pool of threads.

The kernels and torch release the GIL, so threads suffice; each is single-threaded inside, because on a
network of this size a second torch thread gains nothing and costs tenfold under load.
"""

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import Any, TypeVar

from fastapi import Request
from starlette.requests import ClientDisconnect

from app.problems import OVERLOADED, ProblemError

T = TypeVar("T")


def _single_threaded() -> None:
    from model.detector import use_one_thread  # here, so that the application answers before torch is imported

    use_one_thread()


async def _disconnected(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass


class WorkPool:
    """At most ``workers`` pieces of work run and ``queue`` more requests wait; the rest is refused."""

    def __init__(self, workers: int, queue: int) -> None:
        self.workers = workers
        self.capacity = workers + queue
        self._admitted = 0
        self._lock = threading.Lock()
        self._unfinished: set[Future[Any]] = set()
        self._executor = ThreadPoolExecutor(workers, thread_name_prefix="mesh", initializer=_single_threaded)

    @property
    def admitted(self) -> int:
        """Requests that hold a place: uploading, waiting, or being worked on."""
        return self._admitted

    def admit(self) -> "Place":
        """Take a place, before the upload is read, so that the memory held by uploads is bounded too.

        Raises:
            ProblemError: ``overloaded`` (503, with ``Retry-After``).
        """
        with self._lock:
            if self._admitted >= self.capacity:
                raise ProblemError(OVERLOADED, OVERLOADED.example, {"Retry-After": "1"})
            self._admitted += 1
        return Place(self)

    @property
    def busy(self) -> bool:
        """Whether any work, the application's own included, waits or runs."""
        return bool(self._unfinished)

    def submit(self, work: Callable[[], T]) -> Future[T]:
        """Run ``work()`` on a worker outside the bound: for the application's own chores and for places."""
        future = self._executor.submit(work)
        self._unfinished.add(future)
        future.add_done_callback(self._unfinished.discard)
        return future

    def release(self) -> None:
        """Give one place back."""
        with self._lock:
            self._admitted -= 1

    def close(self, wait: bool) -> None:
        """Accept no more work, drop what waits, and with ``wait`` let finish what runs."""
        self._executor.shutdown(wait=wait, cancel_futures=True)


class Place:
    """A request's place in the pool, a context manager.

    It is given back when the work ends, not when the client or the deadline gives up: a thread cannot be
    stopped, and until it is done its core is taken.
    """

    def __init__(self, pool: WorkPool) -> None:
        self._pool = pool
        self._submitted = False

    def __enter__(self) -> "Place":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._submitted:
            self._pool.release()

    async def run(self, request: Request, work: Callable[[], T]) -> T:
        """The result of ``work()``, computed on a worker.

        Work that still waits is dropped when the task is cancelled or the client leaves.

        Raises:
            ClientDisconnect: the client left.
        """
        future = self._pool.submit(work)
        self._submitted = True
        future.add_done_callback(lambda _: self._pool.release())
        result = asyncio.wrap_future(future)
        gone = asyncio.create_task(_disconnected(request))
        try:
            await asyncio.wait({result, gone}, return_when=asyncio.FIRST_COMPLETED)
            if not result.done():
                raise ClientDisconnect
            return result.result()
        finally:
            gone.cancel()
            result.cancel()
