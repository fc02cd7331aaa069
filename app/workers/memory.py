"""Pages of memory that a worker writes to in every job, copied all at once before the first.

A worker shares its memory with the process it was forked from until one of them writes to a page. Each first write is a
fault, some thousands in the first job. Which pages those are is seen once, in a worker that has done a job
(`written_ranges`); every later one asks for its own copies in a few calls (`populate`), while nobody waits for it.
"""

import contextlib
import ctypes
import mmap
import os
from collections.abc import Sequence

import numpy as np

_PRESENT, _OF_FILE, _EXCLUSIVE = 63, 61, 56  # bits of an entry of /proc/self/pagemap
_POPULATE_WRITE = 23  # of madvise, since Linux 5.14
Range = tuple[int, int]
"""First address, and the one behind the last."""


def writable_ranges() -> list[Range]:
    """The parts of this process's memory that it may write to and shares with nobody; empty where nothing tells."""
    found: list[Range] = []
    with contextlib.suppress(OSError), open("/proc/self/maps") as file:
        for line in file:
            span, permissions = line.split(maxsplit=2)[:2]
            if permissions == "rw-p":
                first, end = span.split("-")
                found.append((int(first, 16), int(end, 16)))
    return found


def open_pagemap() -> int | None:
    """A descriptor that `written_ranges` reads from, for it may be used where no file can be opened any more."""
    with contextlib.suppress(OSError):
        return os.open("/proc/self/pagemap", os.O_RDONLY | os.O_CLOEXEC)
    return None


def written_ranges(pagemap: int | None, within: Sequence[Range]) -> list[Range]:
    """Those pages of ``within`` of which this process has copies of its own, side by side ones as one range."""
    found: list[Range] = []
    if pagemap is None:
        return found
    for first, end in within:
        with contextlib.suppress(OSError):
            entries = np.frombuffer(
                os.pread(pagemap, (end - first) // mmap.PAGESIZE * 8, first // mmap.PAGESIZE * 8), "<u8"
            )
            own = (entries >> _PRESENT & 1 == 1) & (entries >> _EXCLUSIVE & 1 == 1) & (entries >> _OF_FILE & 1 == 0)
            steps = np.diff(np.concatenate([[False], own, [False]]).astype(np.int8))
            starts, ends = np.flatnonzero(steps == 1), np.flatnonzero(steps == -1)
            found += [
                (first + int(a) * mmap.PAGESIZE, first + int(b) * mmap.PAGESIZE)
                for a, b in zip(starts, ends, strict=True)
            ]
    return found


def populate(ranges: Sequence[Range]) -> None:
    """Have copies of these pages. Where the kernel does not know how, each is copied when it is written to, as ever."""
    advise = ctypes.CDLL(None).madvise
    advise.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)
    for first, end in ranges:
        advise(first, end - first, _POPULATE_WRITE)
