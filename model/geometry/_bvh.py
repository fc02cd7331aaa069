"""The bounding-volume hierarchy behind ``model.geometry.surface``: how it is laid out.

Nodes are wide and leaves small, so that the loops over them become vector instructions. Triangles are sorted into cells
along a space-filling curve (``_bvh_cells``); above these the tree is built by splitting (``_bvh_split``). The node of a
cell is made when a query first looks into it (``_bvh_lowest``), and what it needs to know of a triangle when that is
first looked at (``_bvh_frames``): of a large mesh most never are.
"""

from typing import NamedTuple

import numpy as np

from model._jit import jit_allocating
from model.types import FloatArray, IntArray

FANOUT = 8
LANES = 4
CELL = FANOUT * LANES
"""A lowest node has so many triangles at most."""

ROWS = 14
# Binary splits on any path: twice the balanced depth by area, then strictly by halves, and the cells below. A traversal
# keeps at most FANOUT - 1 siblings for each, so this stack is enough for 2^31 triangles.
STACK = 1024


class Tree(NamedTuple):
    """What kernels are given of a surface. The root is node 0.

    ``boxes`` ``(nodes * 6 * FANOUT,)``: lower x, y, z, upper x, y, z of every child; inverted infinities if empty.
    ``children`` ``(nodes * FANOUT,)``: a node, or ~leaf when negative.
    ``upper``: so many nodes come first that are whole; those with higher numbers are of cells, and made when needed.
    ``cells`` ``(nodes - upper, 3)``: of each the range of ``order`` that it holds, and its first leaf.
    ``order`` ``(m,)``: the triangles, as they were sorted.
    ``row_of`` ``(nodes - upper,)``: where the boxes and children of a cell's node are; see ``model._atomic``.
    ``frames`` ``((leaves + 1) * ROWS * LANES,)``: one orthonormal frame a triangle, see ``_bvh_frames``.
    ``frames_of`` ``(leaves,)``: where those of a leaf are, counted in leaves; see ``model._atomic``.
    ``taken`` ``(2,)``: the first row, and the first place for frames, that is free. What is made lies together.
    ``owners`` ``(leaves * LANES,)``: the triangles; short leaves repeat their last one. Those of cells are set when
    their node is made.
    ``vertices`` ``(v, 3)``, ``faces`` ``(f, 3)``: of the surface, in the axes of the tree.
    ``left`` ``(2,)``: work that so many queries may still do, and that all may, see ``_bvh_query.charge``.
    ``rounding``: a distance that is nothing but that.
    """

    boxes: FloatArray
    children: IntArray
    upper: int
    cells: IntArray
    order: IntArray
    row_of: IntArray
    frames: FloatArray
    frames_of: IntArray
    taken: IntArray
    owners: IntArray
    vertices: FloatArray
    faces: IntArray
    left: FloatArray
    rounding: float


class Scratch(NamedTuple):
    """What a query writes on: nodes that are ``waiting`` and their squared distances, those of children, of a leaf.

    And what making the node of a cell takes: ``boxes`` ``(CELL, 6)``, ``middles`` ``(CELL, 3)``, the ``places`` and
    ``spans`` of triangles in it.
    """

    waiting: IntArray
    waiting_squared: FloatArray
    child_squared: FloatArray
    leaf_squared: FloatArray
    boxes: FloatArray
    middles: FloatArray
    places: IntArray
    spans: IntArray


@jit_allocating
def scratch() -> Scratch:
    """One for all queries of a kernel."""
    return Scratch(
        np.empty(STACK, dtype=np.int32),
        np.empty(STACK),
        np.empty(FANOUT),
        np.empty(LANES),
        np.empty((CELL, 6)),
        np.empty((CELL, 3)),
        np.empty(CELL, dtype=np.int32),
        np.empty((CELL, 2), dtype=np.int32),
    )
