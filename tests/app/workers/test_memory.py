"""Pages that a worker writes to in every job are its own before the first one."""

import mmap
import os
import resource
import sys
from collections.abc import Callable

import numpy as np
import pytest

from app.workers import memory
from model.types import IntArray

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
PAGES = 64
WRITTEN = [3, 4, 5, 40]


@pytest.fixture
def area() -> IntArray:
    """Memory of this process alone, all of its pages used."""
    return np.frombuffer(mmap.mmap(-1, PAGES * mmap.PAGESIZE, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS), np.int64).copy()


def in_child(action: Callable[[], bytes]) -> bytes:
    """What ``action`` returns in a process forked from this one."""
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        try:
            os.write(writing, action())
        finally:
            os._exit(0)
    os.close(writing)
    with open(reading, "rb") as pipe:
        answer = pipe.read()
    os.waitpid(pid, 0)
    return answer


def test_pages_that_a_child_writes_to_are_found_and_copied_at_once(area: IntArray) -> None:
    first = area.ctypes.data // mmap.PAGESIZE * mmap.PAGESIZE + mmap.PAGESIZE  # of its whole pages
    of_page = mmap.PAGESIZE // area.itemsize
    base = (first - area.ctypes.data) // area.itemsize
    within = [(first, first + (PAGES - 2) * mmap.PAGESIZE)]
    assert any(start <= first < end for start, end in memory.writable_ranges())

    def write() -> bytes:
        for page in WRITTEN:
            area[base + page * of_page] = page + 1
        found = memory.written_ranges(memory.open_pagemap(), within)
        return repr([((a - first) // mmap.PAGESIZE, (b - first) // mmap.PAGESIZE) for a, b in found]).encode()

    found: list[memory.Range] = eval(in_child(write))
    assert found == [(3, 6), (40, 41)]
    ranges = [(first + a * mmap.PAGESIZE, first + b * mmap.PAGESIZE) for a, b in found]

    def faults_of_writing(populated: bool) -> int:
        def count() -> bytes:
            memory.populate(ranges if populated else [])
            before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
            for page in WRITTEN:
                area[base + page * of_page] += 1
            return str(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before).encode()

        return int(in_child(count))

    assert faults_of_writing(populated=True) <= faults_of_writing(populated=False) - len(WRITTEN) + 1


def test_without_a_pagemap_nothing_is_copied_ahead(area: IntArray) -> None:
    assert memory.written_ranges(None, [(area.ctypes.data, area.ctypes.data + area.nbytes)]) == []
    memory.populate([(1 << 46, (1 << 46) + mmap.PAGESIZE)])  # nothing is there: no harm is done
