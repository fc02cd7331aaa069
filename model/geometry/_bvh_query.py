"""Exact closest points with the tree of ``model.geometry._bvh``."""

import numpy as np

from model._jit import jit, jit_allocating, jit_inlined
from model.geometry._bvh import FANOUT, LANES, Scratch, Tree, scratch
from model.geometry._bvh_frames import closest_on, near_leaf
from model.geometry._bvh_lanes import lowest, near_boxes
from model.geometry._bvh_lowest import row_of
from model.types import AnyArray, FloatArray, IntArray

ROUNDING = 1e-15
"""Part of the largest coordinate: what is nearer by less is not looked for. Overlapping triangles of one plane are all
equally far from a point, and each would be looked into for the sake of the last digit."""

_WORK_A_QUERY = 200.0
"""Nodes and leaves that a query may look into on average, beyond `_WORK_AT_FIRST`: on surfaces where boxes can be told
apart it is some ten, and below 200 for a million faces."""

_WORK_AT_FIRST = 0.2
"""Part of all work that queries may do whatever their number."""


@jit
def _beaten(squared: float, rounding: float) -> float:
    """The squared distance of boxes that hold nothing nearer, but for rounding."""
    distance = max(np.sqrt(squared) - rounding, 0.0)
    return distance * distance


@jit_inlined
def nearest(x: float, y: float, z: float, seed: int, bound: float, tree: Tree, scratch: Scratch) -> tuple[float, int]:
    """Squared distance of a point and the leaf lane it was found in; the bound and -1 if nothing is closer (squared).

    The search begins in the leaf `seed`: if it is near, it prunes the tree at once.

    Every node and leaf that is looked into counts as one unit of the work that the tree may do, see `charge`. Once that
    is used up, only the leaf `seed` is looked into: the caller must ask `SurfaceIndex.require_work` before it believes
    what a kernel found. (Threads that share a tree may lose some of each other's counts.)
    """
    waiting, waiting_squared = scratch.waiting, scratch.waiting_squared
    child_squared, leaf_squared = scratch.child_squared, scratch.leaf_squared
    visits = 0
    best, found = bound, -1
    bits = near_leaf(seed, x, y, z, best, tree, leaf_squared)
    while bits:
        lane = lowest(bits)
        bits &= bits - 1
        if leaf_squared[lane] < best:
            best, found = float(leaf_squared[lane]), seed * LANES + lane
    enough = _beaten(best, tree.rounding)
    waiting[0], waiting_squared[0] = 0, 0.0
    top = 1 if tree.left[1] > 0.0 else 0
    while top > 0:
        top -= 1
        if waiting_squared[top] >= enough:
            continue
        visits += 1
        node = int(waiting[top])
        if node < 0:
            if ~node != seed:
                bits = near_leaf(~node, x, y, z, best, tree, leaf_squared)
                if bits:
                    while bits:
                        lane = lowest(bits)
                        bits &= bits - 1
                        if leaf_squared[lane] < best:
                            best, found = float(leaf_squared[lane]), ~node * LANES + lane
                    enough = _beaten(best, tree.rounding)
            continue
        row = row_of(node, tree, scratch)
        bits = near_boxes(tree.boxes, row * 6 * FANOUT, x, y, z, enough, child_squared)
        bottom = top
        while bits:  # kept sorted, the nearest on top
            child = lowest(bits)
            bits &= bits - 1
            value = child_squared[child]
            place = top
            while place > bottom and waiting_squared[place - 1] < value:
                waiting_squared[place], waiting[place] = waiting_squared[place - 1], waiting[place - 1]
                place -= 1
            waiting_squared[place], waiting[place] = value, tree.children[row * FANOUT + child]
            top += 1
    charge(tree, visits)
    return best, found


@jit
def charge(tree: Tree, visits: int) -> None:
    """Count what a query has cost: of what so many queries may do, and of all the work."""
    left = tree.left
    left[1] -= visits
    left[0] += _WORK_A_QUERY - visits
    if left[0] < 0.0:  # a search asks for so much that it would not end
        left[1] = min(left[1], 0.0)


def work_at_first(work: float) -> float:
    """What queries may do whatever their number, of all that they may do."""
    return _WORK_AT_FIRST * work


@jit_allocating
def search(
    points: FloatArray,
    order: IntArray,
    tree: Tree,
    bound: float,
    stop_above: float,
    squared: FloatArray,
    lanes_found: AnyArray,
) -> float:
    """Squared distance of every point, visited in the given order, and the leaf lane where it was found.

    Only surface closer than `bound` (squared) counts; lane -1 and infinity where there is none. The search ends early,
    leaving the rest of the outputs unset, when the sum of the squared distances exceeds `stop_above`.

    Returns:
        The sum of the squared distances so far.
    """
    paper = scratch()
    total = 0.0
    recent = 0  # the leaf nearest to the previous point: likely near this one too
    for step in range(order.shape[0]):
        point = order[step]
        best, found = nearest(points[point, 0], points[point, 1], points[point, 2], recent, bound, tree, paper)
        if found >= 0:
            recent = found // LANES
        else:
            best = np.inf
        squared[point] = best
        lanes_found[point] = found
        total += best
        if total > stop_above:
            break
    return total


@jit
def closest_points(points: FloatArray, lanes_found: AnyArray, tree: Tree, result: FloatArray) -> None:
    """The point of the triangle in the given lane that is closest to each point; NaN for lane -1."""
    for point in range(points.shape[0]):
        if lanes_found[point] < 0:
            result[point] = np.nan
            continue
        x, y, z = points[point, 0], points[point, 1], points[point, 2]
        result[point, 0], result[point, 1], result[point, 2] = closest_on(x, y, z, lanes_found[point], tree)
