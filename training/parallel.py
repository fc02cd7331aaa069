"""Map a function over items, in this process or in several."""

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import TypeVar

Job = TypeVar("Job")
Result = TypeVar("Result")


def spread(work: Callable[[Job], Result], jobs: Sequence[Job], workers: int, *, chunk: int = 1) -> Iterator[Result]:
    """The results of ``work`` on all jobs, in their order; ``work`` is a function of a module.

    Args:
        work: called once for every job, in this process if ``workers`` is 1.
        jobs: what it is called with.
        workers: processes. They are spawned: threads of torch and of the kernels do not survive a fork.
        chunk: so many jobs at a time go to a process.
    """
    if workers <= 1:
        yield from map(work, jobs)
        return
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        yield from pool.map(work, jobs, chunksize=chunk)
