"""The lowest two levels of the tree of ``model.geometry._bvh``, by a space-filling curve and not by splitting.

Splitting costs every triangle one step a level, some twenty of a million triangles. Here references are sorted once by
the Morton code of their middle; cells of an octree with few of them become the lowest nodes, and only above these the
tree is built by splitting. A query looks into about as many nodes either way, but where boxes crowd.
"""

import numpy as np

from model._jit import jit, jit_allocating
from model.geometry._bvh import FANOUT, LANES
from model.geometry._bvh_split import half_surface
from model.geometry._morton import BITS, code, scale_of, sort_range
from model.types import AnyArray, FloatArray, IntArray

_CELL = FANOUT * LANES
"""A lowest node has so many references at most."""

_ALONE = 16.0
"""A box whose surface is so many times the mean is no part of a cell, which it would make large."""


@jit_allocating
def sort_into_cells(refs: FloatArray) -> tuple[IntArray, IntArray, FloatArray, bool]:
    """Sort references into cells.

    Args:
        refs: (m, 6) boxes.

    Returns:
        (m,) the order of the references, (c, 2) which range of it each cell is, (c, 6) boxes of the cells, and whether
        many references had one centre: they may be of one triangle, many times.
    """
    count = refs.shape[0]
    order, spare = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.int32)
    keys, spare_keys = np.empty(count, dtype=np.int32), np.empty(count, dtype=np.int32)
    inside = _code_all(refs, keys, order)
    cells = np.empty((count, 2), dtype=np.int32)
    found = 0
    crowded = False
    # Ranges that are to be sorted, last in, first out: what shares a cell of the finest grid is sorted again by itself.
    waiting = np.empty((count // _CELL + 2, 2), dtype=np.int32)
    waiting[0, 0], waiting[0, 1] = 0, inside
    left, coded = 1, True
    starts = np.empty(1 << BITS, dtype=np.int64)
    while left > 0:
        left -= 1
        first, last = int(waiting[left, 0]), int(waiting[left, 1])
        coincide = not coded and _code(refs, order, first, last, keys)
        coded = False
        if not coincide:
            sort_range(keys, order, spare_keys, spare, first, last, starts)
        place = first
        while place < last:
            end = _cell_end(keys, place, first, last)
            if end - place > _CELL and not coincide:
                waiting[left, 0], waiting[left, 1] = place, end
                left += 1
                place = end
                continue
            if end - place > _CELL:
                crowded = True
                end = place + _CELL
            cells[found, 0], cells[found, 1] = place, end
            found += 1
            place = end
    for place in range(inside, count):
        cells[found, 0], cells[found, 1] = place, place + 1
        found += 1
    boxes = np.empty((found, 6))
    middles, spans = np.empty((_CELL, 3)), np.empty((_CELL, 2), dtype=np.int64)
    for cell in range(found):
        _into_leaves(refs, order[cells[cell, 0] : cells[cell, 1]], middles, spans)
        _cover(refs, order, cells[cell, 0], cells[cell, 1], boxes[cell])
    return order, cells[:found].copy(), boxes, crowded


@jit_allocating
def with_cells(
    refs: FloatArray, owners: IntArray, order: IntArray, cells: IntArray, top: FloatArray, top_children: IntArray
) -> tuple[FloatArray, IntArray, IntArray]:
    """The whole tree: the nodes above the cells (``_bvh_split``), and the cells below them.

    Args:
        refs: (m, 6) boxes.
        owners: (m,) the face that each belongs to.
        order: (m,) of the references, as they were sorted.
        cells: (c, 2) which range of it each cell is.
        top: boxes of the nodes above.
        top_children: ~cell where a child is a cell.

    Returns:
        boxes, children and owners as in ``_bvh.Tree``.
    """
    upper = top_children.shape[0] // FANOUT
    lower, leaves = 0, 0
    for cell in range(cells.shape[0]):
        parts = (cells[cell, 1] - cells[cell, 0] + LANES - 1) // LANES
        lower, leaves = lower + (1 if parts > 1 else 0), leaves + parts
    boxes, children = np.empty((upper + lower) * 6 * FANOUT), np.empty((upper + lower) * FANOUT, dtype=np.int32)
    boxes[: top.shape[0]] = top
    lanes = np.empty(leaves * LANES, dtype=np.int32)
    nodes, found = upper, 0
    box = np.empty(6)
    for slot in range(top_children.shape[0]):
        children[slot] = top_children[slot]
        if top_children[slot] >= 0:
            continue
        cell = ~top_children[slot]
        start, end = int(cells[cell, 0]), int(cells[cell, 1])
        children[slot] = ~found if end - start <= LANES else nodes
        for low in range(start, end, LANES):
            for lane in range(LANES):
                lanes[found * LANES + lane] = owners[order[min(low + lane, end - 1)]]
            if end - start > LANES:
                part = (low - start) // LANES
                _cover(refs, order, low, min(low + LANES, end), box)
                for side in range(6):
                    boxes[(nodes * 6 + side) * FANOUT + part] = box[side]
                children[nodes * FANOUT + part] = ~found
            found += 1
        if end - start > LANES:
            for part in range((end - start + LANES - 1) // LANES, FANOUT):
                for side in range(6):
                    boxes[(nodes * 6 + side) * FANOUT + part] = np.inf if side < 3 else -np.inf
                children[nodes * FANOUT + part] = 0
            nodes += 1
    return boxes, children, lanes


@jit
def _cover(refs: FloatArray, order: IntArray, start: int, end: int, box: FloatArray) -> None:
    """Fill `box` with what covers a range of the sorted references."""
    ax, ay, az, bx, by, bz = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
    for place in range(start, end):
        ref = order[place]
        ax, ay, az = min(ax, refs[ref, 0]), min(ay, refs[ref, 1]), min(az, refs[ref, 2])
        bx, by, bz = max(bx, refs[ref, 3]), max(by, refs[ref, 4]), max(bz, refs[ref, 5])
    box[0], box[1], box[2], box[3], box[4], box[5] = ax, ay, az, bx, by, bz


@jit
def _code_all(refs: FloatArray, keys: IntArray, order: IntArray) -> int:
    """Morton codes of all references, in two passes; the largest come last, without: how many are before them."""
    count = refs.shape[0]
    surface = 0.0
    ax, ay, az, bx, by, bz = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
    for ref in range(count):
        surface += half_surface(refs[ref])
        x, y, z = refs[ref, 0] + refs[ref, 3], refs[ref, 1] + refs[ref, 4], refs[ref, 2] + refs[ref, 5]
        ax, ay, az = min(ax, x), min(ay, y), min(az, z)
        bx, by, bz = max(bx, x), max(by, y), max(bz, z)
    scale = scale_of(bx - ax, by - ay, bz - az)
    limit = surface / count * _ALONE
    inside, outside = 0, count
    for ref in range(count):
        if half_surface(refs[ref]) > limit:
            outside -= 1
            order[outside] = ref
        else:
            order[inside] = ref
            keys[inside] = _key(refs, ref, ax, ay, az, scale)
            inside += 1
    return inside


@jit
def _key(refs: FloatArray, ref: int, x: float, y: float, z: float, scale: float) -> int:
    """The Morton code of a reference's doubled middle, from a corner of the grid on."""
    i = int((refs[ref, 0] + refs[ref, 3] - x) * scale)
    j = int((refs[ref, 1] + refs[ref, 4] - y) * scale)
    k = int((refs[ref, 2] + refs[ref, 5] - z) * scale)
    return code(i, j, k)


@jit
def _code(refs: FloatArray, order: IntArray, first: int, last: int, keys: IntArray) -> bool:
    """Fill ``keys[first:last]`` with Morton codes in the range's own box of middles; whether all are at one place."""
    ax, ay, az, bx, by, bz = np.inf, np.inf, np.inf, -np.inf, -np.inf, -np.inf
    for place in range(first, last):
        ref = order[place]
        x, y, z = refs[ref, 0] + refs[ref, 3], refs[ref, 1] + refs[ref, 4], refs[ref, 2] + refs[ref, 5]
        ax, ay, az = min(ax, x), min(ay, y), min(az, z)
        bx, by, bz = max(bx, x), max(by, y), max(bz, z)
    scale = scale_of(bx - ax, by - ay, bz - az)
    for place in range(first, last):
        keys[place] = _key(refs, int(order[place]), ax, ay, az, scale)
    return scale == 0.0


@jit
def _into_leaves(refs: FloatArray, order: IntArray, middles: FloatArray, spans: AnyArray) -> None:
    """Arrange the references of a cell so that those of a leaf lie together: by halves, along the widest axis."""
    if order.shape[0] <= LANES:
        return
    for place in range(order.shape[0]):
        ref = order[place]
        for axis in range(3):
            middles[place, axis] = refs[ref, axis] + refs[ref, 3 + axis]
    spans[0, 0], spans[0, 1] = 0, order.shape[0]
    open_spans = 1
    while open_spans > 0:
        open_spans -= 1
        start, end = spans[open_spans, 0], spans[open_spans, 1]
        axis, widest = 0, -1.0
        for other in range(3):
            low, high = np.inf, -np.inf
            for place in range(start, end):
                low, high = min(low, middles[place, other]), max(high, middles[place, other])
            if high - low > widest:
                axis, widest = other, high - low
        leaves = (end - start + LANES - 1) // LANES
        middle = start + (leaves + 1) // 2 * LANES
        _select(middles, order, axis, start, end - 1, middle)
        if middle - start > LANES:
            spans[open_spans, 0], spans[open_spans, 1] = start, middle
            open_spans += 1
        if end - middle > LANES:
            spans[open_spans, 0], spans[open_spans, 1] = middle, end
            open_spans += 1


@jit
def _select(middles: FloatArray, order: IntArray, axis: int, low: int, high: int, rank: int) -> None:
    """Rearrange so that no middle before a place lies farther along the axis than any from it on."""
    while low < high:
        pivot = middles[(low + high) // 2, axis]
        left, right = low, high
        while left <= right:
            while middles[left, axis] < pivot:
                left += 1
            while pivot < middles[right, axis]:
                right -= 1
            if left <= right:
                for other in range(3):
                    middles[left, other], middles[right, other] = middles[right, other], middles[left, other]
                order[left], order[right] = order[right], order[left]
                left, right = left + 1, right - 1
        if rank <= right:
            high = right
        elif rank >= left:
            low = left
        else:
            break


@jit
def _cell_end(keys: IntArray, place: int, first: int, last: int) -> int:
    """The end of the largest cell that begins at a place and has few references; of the finest one, if it has many."""
    level = 0
    end = place + 1
    while end < last and keys[end] == keys[place]:
        end += 1
    if end - place > _CELL:
        return end
    while level < 3 * BITS:
        level += 1
        if place > first and keys[place - 1] >> level == keys[place] >> level:
            break
        reach = place + _CELL
        if reach < last and keys[reach] >> level == keys[place] >> level:
            break
        while end < last and end < reach and keys[end] >> level == keys[place] >> level:
            end += 1
    return end
