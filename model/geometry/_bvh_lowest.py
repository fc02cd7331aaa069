"""The lowest nodes of the tree of ``model.geometry._bvh``, each made of its cell when a query first looks into it.

They are put side by side as they are made, as are the frames of triangles: what is near in space is looked at one after
the other, and then lies together in memory.
"""

import numpy as np

from model._atomic import claim, publish, published, take, wait_for
from model._jit import jit, jit_allocating, jit_inlined
from model.geometry._bvh import FANOUT, LANES, Scratch, Tree, scratch
from model.geometry._bvh_cells import box_of
from model.types import FloatArray, IntArray


@jit_allocating
def make_first(tree: Tree) -> None:
    """Make the first cell, if there is any: queries begin in the first leaf."""
    if tree.row_of.shape[0] > 0:
        row_of(tree.upper, tree, scratch())


@jit_inlined
def row_of(node: int, tree: Tree, paper: Scratch) -> int:
    """Where the boxes and children of a node are, which is made if it is not."""
    if node < tree.upper:
        return node
    row = published(tree.row_of, node - tree.upper)
    return row if row > 0 else _made(node - tree.upper, tree, paper)


@jit
def _made(cell: int, tree: Tree, paper: Scratch) -> int:
    if not claim(tree.row_of, cell):
        return wait_for(tree.row_of, cell)
    node = take(tree.taken, 0)
    start, end, leaf = tree.cells[cell, 0], tree.cells[cell, 1], tree.cells[cell, 2]
    count = end - start
    boxes, middles, places = paper.boxes, paper.middles, paper.places
    for place in range(count):
        lx, ly, lz, hx, hy, hz = box_of(tree.vertices, tree.faces, int(tree.order[start + place]))
        boxes[place, 0], boxes[place, 1], boxes[place, 2] = lx, ly, lz
        boxes[place, 3], boxes[place, 4], boxes[place, 5] = hx, hy, hz
        middles[place, 0], middles[place, 1], middles[place, 2] = lx + hx, ly + hy, lz + hz
        places[place] = place
    _into_leaves(count, places, middles, paper.spans)
    parts = (count + LANES - 1) // LANES
    for part in range(parts):
        low = part * LANES
        high = min(low + LANES, count)
        at = (leaf + part) * LANES
        for lane in range(LANES):
            tree.owners[at + lane] = tree.order[start + places[min(low + lane, count - 1)]]
        for side in range(6):
            value = boxes[places[low], side]
            for place in range(low + 1, high):
                other = boxes[places[place], side]
                value = min(value, other) if side < 3 else max(value, other)
            tree.boxes[(node * 6 + side) * FANOUT + part] = value
        tree.children[node * FANOUT + part] = ~(leaf + part)
    for part in range(parts, FANOUT):
        for side in range(6):
            tree.boxes[(node * 6 + side) * FANOUT + part] = np.inf if side < 3 else -np.inf
        tree.children[node * FANOUT + part] = 0
    publish(tree.row_of, cell, node)
    return node


@jit
def _into_leaves(count: int, order: IntArray, middles: FloatArray, spans: IntArray) -> None:
    """Arrange the triangles of a cell so that those of a leaf lie together: by halves, along the widest axis."""
    spans[0, 0], spans[0, 1] = 0, count
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
