"""Morton codes: numbers along a space-filling curve, so that what is near in them is near in space."""

import numpy as np

from model._jit import jit, jit_allocating, jit_inlined
from model.types import AnyArray, FloatArray, IntArray

BITS = 10
"""Of a code, for each axis."""


@jit_allocating
def morton_order(points: FloatArray) -> IntArray:
    """Indices that visit the points along a space-filling curve, so that neighbours follow each other."""
    count = points.shape[0]
    low = np.full(3, np.inf)
    high = np.full(3, -np.inf)
    for point in range(count):
        for axis in range(3):
            low[axis] = min(low[axis], points[point, axis])
            high[axis] = max(high[axis], points[point, axis])
    scale = scale_of(high[0] - low[0], high[1] - low[1], high[2] - low[2])
    rows, sorted_rows = np.empty(count, dtype=np.int64), np.empty(count, dtype=np.int64)
    for point in range(count):
        i = int((points[point, 0] - low[0]) * scale)
        j = int((points[point, 1] - low[1]) * scale)
        k = int((points[point, 2] - low[2]) * scale)
        rows[point] = row_of(code(i, j, k), point)
    sort_rows(rows, sorted_rows, 0, count, np.empty((3, 1 << BITS), dtype=np.int64))
    order = np.empty(count, dtype=np.int32)
    for place in range(count):
        order[place] = index_of(sorted_rows[place])
    return order


@jit_inlined
def row_of(key: int, index: int) -> int:
    """A code and the index of what has it, in one number: they are moved together."""
    return (key << 32) | index


@jit_inlined
def index_of(row: int) -> int:
    """The index in a row."""
    return row & 0x7FFFFFFF


@jit_inlined
def code_of(row: int) -> int:
    """The code in a row."""
    return row >> 32


@jit
def scale_of(x: float, y: float, z: float) -> float:
    """Cells of the grid of codes to a unit of length, for a box of these sides; 0 for a box of no size."""
    width = max(x, y, z)
    return ((1 << BITS) - 1) / width if width > 1e-290 else 0.0


@jit
def code(i: int, j: int, k: int) -> int:
    """The code of a cell of the grid."""
    return _spaced(i) | (_spaced(j) << 1) | (_spaced(k) << 2)


@jit
def _spaced(cell: int) -> int:
    """The ten bits of a number with two zeros after each."""
    cell = (cell | (cell << 16)) & 0x030000FF
    cell = (cell | (cell << 8)) & 0x0300F00F
    cell = (cell | (cell << 4)) & 0x030C30C3
    return (cell | (cell << 2)) & 0x09249249


@jit
def sort_rows(rows: AnyArray, sorted_rows: AnyArray, first: int, last: int, starts: AnyArray) -> None:
    """Sort a range of rows by their codes into the same range of ``sorted_rows``; equal ones stay in their order.

    By the lowest ten bits, the next ten, and the highest. ``starts`` ``(3, 1 << BITS)`` and ``rows`` are scratch.
    """
    starts[:] = 0
    mask = starts.shape[1] - 1
    for place in range(first, last):
        key = code_of(rows[place])
        starts[0, key & mask] += 1
        starts[1, (key >> BITS) & mask] += 1
        starts[2, (key >> (2 * BITS)) & mask] += 1
    for digit in range(3):
        total = first
        for value in range(starts.shape[1]):
            total, starts[digit, value] = total + starts[digit, value], total
    _move_rows(rows, sorted_rows, first, last, 0, starts[0])
    _move_rows(sorted_rows, rows, first, last, BITS, starts[1])
    _move_rows(rows, sorted_rows, first, last, 2 * BITS, starts[2])


@jit
def _move_rows(rows: AnyArray, moved: AnyArray, first: int, last: int, shift: int, starts: AnyArray) -> None:
    mask = starts.shape[0] - 1
    for place in range(first, last):
        row = rows[place]
        digit = (code_of(row) >> shift) & mask
        moved[starts[digit]] = row
        starts[digit] += 1
