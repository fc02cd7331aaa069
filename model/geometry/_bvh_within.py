"""Whether there is any surface within a distance: cheaper than how far the nearest is, above all where much is near."""

import numpy as np

from model._jit import jit, jit_allocating
from model.geometry._bvh import FANOUT, Scratch, Tree, scratch
from model.geometry._bvh_frames import near_leaf
from model.geometry._bvh_lanes import lowest, near_boxes
from model.geometry._bvh_lowest import row_of
from model.geometry._bvh_query import charge
from model.types import BoolArray, FloatArray, IntArray


@jit_allocating
def search_within(points: FloatArray, order: IntArray, limit: float, tree: Tree, found: BoolArray) -> None:
    """Fill ``found``: whether any triangle is within `limit` (squared) of each point, visited in the given order."""
    paper = scratch()
    recent = 0  # the leaf that was near the previous point
    for step in range(order.shape[0]):
        point = order[step]
        leaf = leaf_within(points[point, 0], points[point, 1], points[point, 2], recent, limit, tree, paper)
        found[point] = leaf >= 0
        if leaf >= 0:
            recent = leaf


@jit
def leaf_within(x: float, y: float, z: float, seed: int, limit: float, tree: Tree, scratch: Scratch) -> int:
    """A leaf with a triangle within `limit`, or -1. It counts its work as ``_bvh_query.nearest`` does."""
    waiting, child_squared, leaf_squared = scratch.waiting, scratch.child_squared, scratch.leaf_squared
    beyond = np.nextafter(limit, np.inf)
    if near_leaf(seed, x, y, z, beyond, tree, leaf_squared):
        return seed
    visits, found = 0, -1
    waiting[0] = 0
    top = 1 if tree.left[1] > 0.0 else 0
    while top > 0 and found < 0:
        top -= 1
        visits += 1
        node = int(waiting[top])
        if node < 0:
            if near_leaf(~node, x, y, z, beyond, tree, leaf_squared):
                found = ~node
            continue
        row = row_of(node, tree, scratch)
        bits = near_boxes(tree.boxes, row * 6 * FANOUT, x, y, z, beyond, child_squared)
        nearest, place = np.inf, top
        while bits:
            child = lowest(bits)
            bits &= bits - 1
            waiting[top] = tree.children[row * FANOUT + child]
            if child_squared[child] < nearest:
                nearest, place = child_squared[child], top
            top += 1
        if top > place + 1:  # the most promising one on top
            waiting[place], waiting[top - 1] = waiting[top - 1], waiting[place]
    charge(tree, visits)
    return found
