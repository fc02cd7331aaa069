"""Morton codes: numbers along a space-filling curve, so that what is near in them is near in space."""

import numpy as np

from model._jit import jit, jit_allocating
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
    keys, order = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.int32)
    for point in range(count):
        i = int((points[point, 0] - low[0]) * scale)
        j = int((points[point, 1] - low[1]) * scale)
        k = int((points[point, 2] - low[2]) * scale)
        keys[point], order[point] = code(i, j, k), point
    spare_keys, spare = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.int32)
    sort_range(keys, order, spare_keys, spare, 0, count, np.empty(1 << BITS, dtype=np.int64))
    return order


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
def sort_range(
    keys: IntArray, order: IntArray, spare_keys: IntArray, spare: IntArray, first: int, last: int, starts: AnyArray
) -> None:
    """Sort a range of keys, and `order` with them: by their lowest ten bits, the next ten, and the highest.

    ``spare_keys``, ``spare`` and ``starts`` ``(1 << BITS,)`` are scratch.
    """
    _sort_digit(keys, order, spare_keys, spare, first, last, 0, starts)
    _sort_digit(spare_keys, spare, keys, order, first, last, BITS, starts)
    _sort_digit(keys, order, spare_keys, spare, first, last, 2 * BITS, starts)
    for place in range(first, last):
        keys[place], order[place] = spare_keys[place], spare[place]


@jit
def _sort_digit(
    keys: IntArray,
    order: IntArray,
    sorted_keys: IntArray,
    sorted_order: IntArray,
    first: int,
    last: int,
    shift: int,
    starts: AnyArray,
) -> None:
    mask = starts.shape[0] - 1
    starts[:] = 0
    for place in range(first, last):
        starts[(keys[place] >> shift) & mask] += 1
    total = first
    for digit in range(starts.shape[0]):
        total, starts[digit] = total + starts[digit], total
    for place in range(first, last):
        digit = (keys[place] >> shift) & mask
        to = starts[digit]
        starts[digit] += 1
        sorted_keys[to], sorted_order[to] = keys[place], order[place]
