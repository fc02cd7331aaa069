"""Construction of the tree of ``model.geometry._bvh`` by splitting, by surface area."""

import numpy as np

from model._jit import jit, jit_allocating
from model.geometry._bvh import FANOUT, STACK
from model.types import FloatArray, IntArray

_BINS = 16
_SORTED = 32  # ranges up to this many cells are sorted
_SAMPLE = 128  # cells that decide a split of a larger range


@jit_allocating
def split(cells: FloatArray, most: int) -> tuple[FloatArray, IntArray, IntArray, IntArray, bool]:
    """Build the nodes above cells.

    Args:
        cells: (c, 6) boxes, at least one; reordered in place.
        most: cells that make a leaf, 1 or ``LANES``.

    Returns:
        boxes and children as in ``_bvh.Tree``, ~leaf where a child is none of the nodes; (c,) the order of the cells,
        (leaves, 2) which range of them each leaf is, and whether many cells had one centre.
    """
    coincide = False
    count = cells.shape[0]
    numbers = np.empty(count, dtype=np.int32)
    for cell in range(count):
        numbers[cell] = cell
    balanced = 1
    while (1 << balanced) < count:
        balanced += 1
    capacity = 2 * count // (most + 2) + 2  # a node is full, or has several leaves and nothing else
    boxes = np.empty(capacity * 6 * FANOUT)
    children = np.empty(capacity * FANOUT, dtype=np.int32)
    leaves = np.empty((count, 2), dtype=np.int32)
    nodes, found = 1, 0
    # Open nodes, last in, first out: node, first cell, end, binary depth; and box with the box of the centres.
    stack = np.empty((STACK, 4), dtype=np.int64)
    stack_box = np.empty((STACK, 12))
    ranges = np.empty((FANOUT, 3), dtype=np.int64)
    extents = np.empty((FANOUT, 12))
    bins = np.empty((_BINS, 8))  # box, cells, cost of a split in front of the bin
    box = np.empty(6)
    keys = np.empty(_SORTED)
    scratch = np.empty((_SORTED, 6))
    scratch_numbers = np.empty(_SORTED, dtype=np.int32)
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = 0, 0, count, 0
    _measure(cells, 0, count, stack_box[0])
    open_nodes = 1
    while open_nodes > 0:
        open_nodes -= 1
        node = stack[open_nodes, 0]
        ranges[0, 0], ranges[0, 1], ranges[0, 2] = stack[open_nodes, 1], stack[open_nodes, 2], stack[open_nodes, 3]
        extents[0] = stack_box[open_nodes]
        used = 1
        while used < FANOUT:
            chosen, largest = -1, -1.0
            for slot in range(used):
                if ranges[slot, 1] - ranges[slot, 0] > most:
                    dx = extents[slot, 3] - extents[slot, 0]
                    dy = extents[slot, 4] - extents[slot, 1]
                    dz = extents[slot, 5] - extents[slot, 2]
                    surface = dx * dy + dy * dz + dz * dx
                    if surface > largest:
                        chosen, largest = slot, surface
            if chosen < 0:
                break
            start, end, depth = ranges[chosen, 0], ranges[chosen, 1], ranges[chosen, 2] + 1
            low, high = extents[chosen], extents[used]
            if end - start <= _SORTED:
                middle = _split_small(cells, numbers, start, end, low, most, keys, box, scratch, scratch_numbers)
                _measure(cells, start, middle, low)
                _measure(cells, middle, end, high)
            else:
                coincide = coincide or (low[6] == low[9] and low[7] == low[10] and low[8] == low[11])
                middle = _split_large(cells, numbers, start, end, low, high, bins, box, depth > 2 * balanced + 8)
            ranges[chosen, 1], ranges[chosen, 2] = middle, depth
            ranges[used, 0], ranges[used, 1], ranges[used, 2] = middle, end, depth
            used += 1
        for slot in range(FANOUT):
            for axis in range(3):
                boxes[(node * 6 + axis) * FANOUT + slot] = extents[slot, axis] if slot < used else np.inf
                boxes[(node * 6 + 3 + axis) * FANOUT + slot] = extents[slot, 3 + axis] if slot < used else -np.inf
            children[node * FANOUT + slot] = 0
            if slot < used:
                if ranges[slot, 1] - ranges[slot, 0] <= most:
                    children[node * FANOUT + slot] = ~found
                    leaves[found, 0], leaves[found, 1] = ranges[slot, 0], ranges[slot, 1]
                    found += 1
                else:
                    children[node * FANOUT + slot] = nodes
                    stack[open_nodes, 0], stack[open_nodes, 1] = nodes, ranges[slot, 0]
                    stack[open_nodes, 2], stack[open_nodes, 3] = ranges[slot, 1], ranges[slot, 2]
                    stack_box[open_nodes] = extents[slot]
                    open_nodes += 1
                    nodes += 1
    boxes, children = boxes[: nodes * 6 * FANOUT].copy(), children[: nodes * FANOUT].copy()
    return boxes, children, numbers, leaves[:found].copy(), coincide


@jit
def _measure(cells: FloatArray, start: int, end: int, extent: FloatArray) -> None:
    """Box of the cells, and box of their centres (doubled, which spares the halving)."""
    # Twelve variables rather than a loop over the axes: they stay in registers, and the data are read once.
    ax, ay, az, bx, by, bz = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
    cx, cy, cz, dx, dy, dz = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
    for cell in range(start, end):
        x, y, z, u, v, w = (
            cells[cell, 0],
            cells[cell, 1],
            cells[cell, 2],
            cells[cell, 3],
            cells[cell, 4],
            cells[cell, 5],
        )
        ax, ay, az = min(ax, x), min(ay, y), min(az, z)
        bx, by, bz = max(bx, u), max(by, v), max(bz, w)
        cx, cy, cz = min(cx, x + u), min(cy, y + v), min(cz, z + w)
        dx, dy, dz = max(dx, x + u), max(dy, y + v), max(dz, z + w)
    extent[0], extent[1], extent[2], extent[3], extent[4], extent[5] = ax, ay, az, bx, by, bz
    extent[6], extent[7], extent[8], extent[9], extent[10], extent[11] = cx, cy, cz, dx, dy, dz


@jit
def _widest(extent: FloatArray) -> int:
    axis = 0
    for other in range(1, 3):
        if extent[9 + other] - extent[6 + other] > extent[9 + axis] - extent[6 + axis]:
            axis = other
    return axis


@jit
def _split_small(
    cells: FloatArray,
    numbers: IntArray,
    start: int,
    end: int,
    extent: FloatArray,
    most: int,
    keys: FloatArray,
    box: FloatArray,
    scratch: FloatArray,
    scratch_numbers: IntArray,
) -> int:
    """Sort a short range along its widest axis; the start of the right side of the best split, by whole leaves."""
    axis = _widest(extent)
    count = end - start
    for index in range(count):
        key = cells[start + index, axis] + cells[start + index, 3 + axis]
        place = index
        while place > 0 and keys[place - 1] > key:
            keys[place] = keys[place - 1]
            scratch_numbers[place] = scratch_numbers[place - 1]
            place -= 1
        keys[place] = key
        scratch_numbers[place] = index
    for index in range(count):
        for column in range(6):
            scratch[index, column] = cells[start + scratch_numbers[index], column]
        scratch_numbers[index] = numbers[start + scratch_numbers[index]]
    for index in range(count):
        for column in range(6):
            cells[start + index, column] = scratch[index, column]
        numbers[start + index] = scratch_numbers[index]
    # Cost of a split: surface of each side times its leaves. Right sides first, kept in `keys`.
    box[:3] = np.inf
    box[3:] = -np.inf
    for index in range(count - 1, 0, -1):
        _grow(box, scratch, index)
        keys[index] = half_surface(box) * ((count - index + most - 1) // most)
    box[:3] = np.inf
    box[3:] = -np.inf
    best, middle = np.inf, most
    for index in range(1, count):
        _grow(box, scratch, index - 1)
        if index % most == 0:
            cost = half_surface(box) * (index // most) + keys[index]
            if cost < best:
                best, middle = cost, index
    return start + middle


@jit
def _grow(box: FloatArray, boxes: FloatArray, row: int) -> None:
    for axis in range(3):
        box[axis] = min(box[axis], boxes[row, axis])
        box[3 + axis] = max(box[3 + axis], boxes[row, 3 + axis])


@jit
def half_surface(box: FloatArray) -> float:
    """Half the surface of a box ``(6,)``."""
    dx, dy, dz = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    return dx * dy + dy * dz + dz * dx


@jit
def _split_large(
    cells: FloatArray,
    numbers: IntArray,
    start: int,
    end: int,
    low: FloatArray,
    high: FloatArray,
    bins: FloatArray,
    box: FloatArray,
    halve: bool,
) -> int:
    """Partition a range at the cheapest of ``_BINS`` planes; the start of the right side.

    `low` holds the extent of the range, and in the end `low` and `high` hold that of each side.
    """
    axis = _widest(low)
    origin = low[6 + axis]
    width = low[9 + axis] - origin
    scale = _BINS * (1.0 - 1e-9) / width if width > 0.0 else np.inf
    if halve or not scale < 1e300:  # coincident centres: any halves will do
        middle = (start + end) // 2
        _measure(cells, start, middle, low)
        _measure(cells, middle, end, high)
        return middle
    bins[:, 0:3] = np.inf
    bins[:, 3:6] = -np.inf
    bins[:, 6] = 0.0
    step = (end - start + _SAMPLE - 1) // _SAMPLE
    for cell in range(start, end, step):
        slot = int((cells[cell, axis] + cells[cell, 3 + axis] - origin) * scale)
        _grow(bins[slot], cells, cell)
        bins[slot, 6] += 1.0
    plane = _cheapest_plane(bins, box)
    left, right = start, end
    while True:
        while left < right and int((cells[left, axis] + cells[left, 3 + axis] - origin) * scale) < plane:
            left += 1
        while left < right and int((cells[right - 1, axis] + cells[right - 1, 3 + axis] - origin) * scale) >= plane:
            right -= 1
        if left >= right:
            break
        right -= 1
        for column in range(6):
            cells[left, column], cells[right, column] = cells[right, column], cells[left, column]
        numbers[left], numbers[right] = numbers[right], numbers[left]
        left += 1
    _measure(cells, start, left, low)
    _measure(cells, left, end, high)
    return left


@jit
def _cheapest_plane(bins: FloatArray, box: FloatArray) -> int:
    """The first bin of the right side, by the surface area heuristic; the middle if the sample fell into one bin."""
    box[:3] = np.inf
    box[3:] = -np.inf
    count = 0.0
    for slot in range(_BINS - 1, 0, -1):
        _grow(box, bins, slot)
        count += bins[slot, 6]
        bins[slot, 7] = half_surface(box) * count if count > 0.0 else np.inf
    box[:3] = np.inf
    box[3:] = -np.inf
    count = 0.0
    best, plane = np.inf, _BINS // 2
    for slot in range(1, _BINS):
        _grow(box, bins, slot - 1)
        count += bins[slot - 1, 6]
        if count > 0.0 and bins[slot, 7] < np.inf:
            cost = half_surface(box) * count + bins[slot, 7]
            if cost < best:
                best, plane = cost, slot
    return plane
