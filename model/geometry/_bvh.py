"""Construction of the bounding-volume hierarchy behind ``model.geometry.surface``: wide nodes, split by surface area.

Arrays of the finished tree (LANES triangles a leaf, FANOUT children a node, both laid out so that the loops over them
become vector instructions):

    boxes     (nodes * 6 * FANOUT,) float64    lower x, y, z, upper x, y, z of every child; inverted infinities if empty
    children  (nodes * FANOUT,) int32          a node, or ~leaf when negative
    frames    (leaves * ROWS * LANES + 3,) float64 one orthonormal frame a triangle, see ``_frame``; the last three
                                               are the work that so many queries may still do, the distance that is
                                               rounding, and the work that all may, see ``_bvh_query.charge``
    owners    (leaves * LANES,) int32          the triangles; short leaves repeat their last one

The root is node 0.
"""

import numpy as np

from model._jit import jit, jit_allocating
from model.types import FloatArray, IntArray

FANOUT = 8
LANES = 4
ROWS = 14
# Binary splits on any path: twice the balanced depth by area, then strictly by halves. A traversal keeps at most
# FANOUT - 1 siblings for each, so this stack is enough for 2^31 triangles.
STACK = 1024
_BINS = 16
_SORTED = 32  # ranges up to this many references are sorted and split at whole leaves
_SAMPLE = 128  # references that decide a split of a larger range


@jit_allocating
def build(refs: FloatArray, owners: IntArray) -> tuple[FloatArray, IntArray, IntArray, bool]:
    """Sort the references into leaves and build the nodes above them.

    Args:
        refs: (m, 6) boxes, reordered in place.
        owners: (m,) face indices, reordered alike.

    Returns:
        boxes and children as in the module's docstring, (leaves, 2) the first reference of each leaf and the end, and
        whether many boxes had one centre: they may be of one triangle, many times.
    """
    crowded = False
    count = refs.shape[0]
    balanced = 1
    while (1 << balanced) < count:
        balanced += 1
    capacity = 2 * count // 5 + 2  # a node is full, or has more than LANES references and only leaves
    boxes = np.empty(capacity * 6 * FANOUT)
    children = np.empty(capacity * FANOUT, dtype=np.int32)
    leaves = np.empty((count, 2), dtype=np.int32)
    nodes, found = 1, 0
    # Open nodes, last in, first out: node, first reference, end, binary depth; and box with the box of the centres.
    stack = np.empty((STACK, 4), dtype=np.int64)
    stack_box = np.empty((STACK, 12))
    ranges = np.empty((FANOUT, 3), dtype=np.int64)
    extents = np.empty((FANOUT, 12))
    bins = np.empty((_BINS, 8))  # box, references, cost of a split in front of the bin
    box = np.empty(6)
    keys = np.empty(_SORTED)
    scratch = np.empty((_SORTED, 6))
    scratch_owners = np.empty(_SORTED, dtype=np.int32)
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = 0, 0, count, 0
    _measure(refs, 0, count, stack_box[0])
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
                if ranges[slot, 1] - ranges[slot, 0] > LANES:
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
                middle = _split_small(refs, owners, start, end, low, keys, box, scratch, scratch_owners)
                _measure(refs, start, middle, low)
                _measure(refs, middle, end, high)
            else:
                crowded = crowded or _coincide(low)
                middle = _split_large(refs, owners, start, end, low, high, bins, box, depth > 2 * balanced + 8)
            ranges[chosen, 1], ranges[chosen, 2] = middle, depth
            ranges[used, 0], ranges[used, 1], ranges[used, 2] = middle, end, depth
            used += 1
        for slot in range(FANOUT):
            for axis in range(3):
                boxes[(node * 6 + axis) * FANOUT + slot] = extents[slot, axis] if slot < used else np.inf
                boxes[(node * 6 + 3 + axis) * FANOUT + slot] = extents[slot, 3 + axis] if slot < used else -np.inf
            children[node * FANOUT + slot] = 0
            if slot < used:
                if ranges[slot, 1] - ranges[slot, 0] <= LANES:
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
    return boxes[: nodes * 6 * FANOUT].copy(), children[: nodes * FANOUT].copy(), leaves[:found].copy(), crowded


@jit
def _measure(refs: FloatArray, start: int, end: int, extent: FloatArray) -> None:
    """Box of the references, and box of their centres (doubled, which spares the halving)."""
    # Twelve variables rather than a loop over the axes: they stay in registers, and the data are read once.
    ax, ay, az, bx, by, bz = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
    cx, cy, cz, dx, dy, dz = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
    for ref in range(start, end):
        x, y, z, u, v, w = refs[ref, 0], refs[ref, 1], refs[ref, 2], refs[ref, 3], refs[ref, 4], refs[ref, 5]
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
def _coincide(extent: FloatArray) -> bool:
    """Whether all centres are at one place."""
    return extent[6] == extent[9] and extent[7] == extent[10] and extent[8] == extent[11]


@jit
def _split_small(
    refs: FloatArray,
    owners: IntArray,
    start: int,
    end: int,
    extent: FloatArray,
    keys: FloatArray,
    box: FloatArray,
    scratch: FloatArray,
    scratch_owners: IntArray,
) -> int:
    """Sort a short range along its widest axis; the best split that fills whole leaves on one side."""
    axis = _widest(extent)
    count = end - start
    for index in range(count):
        key = refs[start + index, axis] + refs[start + index, 3 + axis]
        place = index
        while place > 0 and keys[place - 1] > key:
            keys[place] = keys[place - 1]
            scratch_owners[place] = scratch_owners[place - 1]
            place -= 1
        keys[place] = key
        scratch_owners[place] = index
    for index in range(count):
        for column in range(6):
            scratch[index, column] = refs[start + scratch_owners[index], column]
        scratch_owners[index] = owners[start + scratch_owners[index]]
    for index in range(count):
        for column in range(6):
            refs[start + index, column] = scratch[index, column]
        owners[start + index] = scratch_owners[index]
    # Cost of a split: surface of each side times its leaves. Right sides first, kept in `keys`.
    box[:3] = np.inf
    box[3:] = -np.inf
    for index in range(count - 1, 0, -1):
        _grow(box, scratch, index)
        keys[index] = _half_surface(box) * ((count - index + LANES - 1) // LANES)
    box[:3] = np.inf
    box[3:] = -np.inf
    best, middle = np.inf, LANES
    for index in range(1, count):
        _grow(box, scratch, index - 1)
        if index % LANES == 0:
            cost = _half_surface(box) * (index // LANES) + keys[index]
            if cost < best:
                best, middle = cost, index
    return start + middle


@jit
def _grow(box: FloatArray, boxes: FloatArray, row: int) -> None:
    for axis in range(3):
        box[axis] = min(box[axis], boxes[row, axis])
        box[3 + axis] = max(box[3 + axis], boxes[row, 3 + axis])


@jit
def _half_surface(box: FloatArray) -> float:
    dx, dy, dz = box[3] - box[0], box[4] - box[1], box[5] - box[2]
    return dx * dy + dy * dz + dz * dx


@jit
def _split_large(
    refs: FloatArray,
    owners: IntArray,
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
        _measure(refs, start, middle, low)
        _measure(refs, middle, end, high)
        return middle
    bins[:, 0:3] = np.inf
    bins[:, 3:6] = -np.inf
    bins[:, 6] = 0.0
    step = (end - start + _SAMPLE - 1) // _SAMPLE
    for ref in range(start, end, step):
        slot = int((refs[ref, axis] + refs[ref, 3 + axis] - origin) * scale)
        _grow(bins[slot], refs, ref)
        bins[slot, 6] += 1.0
    plane = _cheapest_plane(bins, box)
    left, right = start, end
    while True:
        while left < right and int((refs[left, axis] + refs[left, 3 + axis] - origin) * scale) < plane:
            left += 1
        while left < right and int((refs[right - 1, axis] + refs[right - 1, 3 + axis] - origin) * scale) >= plane:
            right -= 1
        if left >= right:
            break
        right -= 1
        for column in range(6):
            refs[left, column], refs[right, column] = refs[right, column], refs[left, column]
        owners[left], owners[right] = owners[right], owners[left]
        left += 1
    _measure(refs, start, left, low)
    _measure(refs, left, end, high)
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
        bins[slot, 7] = _half_surface(box) * count if count > 0.0 else np.inf
    box[:3] = np.inf
    box[3:] = -np.inf
    count = 0.0
    best, plane = np.inf, _BINS // 2
    for slot in range(1, _BINS):
        _grow(box, bins, slot - 1)
        count += bins[slot - 1, 6]
        if count > 0.0 and bins[slot, 7] < np.inf:
            cost = _half_surface(box) * count + bins[slot, 7]
            if cost < best:
                best, plane = cost, slot
    return plane
