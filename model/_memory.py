"""Memory for large arrays of which most is never looked at."""

import mmap
import sys

import numpy as np

from model.types import FloatArray

_LARGE = 1 << 20


def sparse_zeros(count: int) -> FloatArray:
    """``count`` zeros (float64) that take memory where they are written to, page by page.

    What numpy gives comes in pages of two megabytes where the system has them: one number written fills one.
    """
    size = 8 * count
    if size < _LARGE or sys.platform != "linux":
        return np.zeros(count)
    try:
        pages = mmap.mmap(-1, size, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    except OSError as error:
        raise MemoryError from error
    pages.madvise(mmap.MADV_NOHUGEPAGE)
    return np.frombuffer(pages, dtype=np.float64)
