"""Exact distances to a surface, on which every symmetry error rests (the paper, Section 3.4)."""

import numpy as np

from model._jit import kernel_array
from model.errors import TooComplexError
from model.geometry._bvh import LANES, ROWS, Tree
from model.geometry._bvh_axes import tree_axes
from model.geometry._bvh_cells import sort_into_cells, with_cells
from model.geometry._bvh_query import ROUNDING, closest_points, search, work_at_first
from model.geometry._bvh_references import references
from model.geometry._bvh_split import split
from model.geometry._bvh_within import search_within
from model.geometry._morton import morton_order
from model.geometry.topology import distinct_faces, duplicate_vertex_map
from model.geometry.transforms import turned
from model.types import AnyArray, BoolArray, FloatArray, IntArray

WORK = 40_000_000
"""Nodes and leaves of the tree that all queries together may look into: some two seconds of an idle core. Of 1,264
meshes in full mode the median takes 0.26 millions, 1 % more than 2.2, and the one that costs most 10.7."""

_FEW = 3_000
"""Up to so many faces the queries of a detection cost more than building the tree."""


class SurfaceIndex:
    """Closest-point queries against a triangle mesh of any quality.

    Distances are exact up to rounding (1e-15 of the coordinates): no grid, no sampling. Slivers,
    faces without area, duplicates and separate bodies are fine. Queries run with the GIL released and may run in
    several threads at once. Coordinates in any one frame; squared distances in the square of its unit.

    What queries cost is counted: where faces crowd so much that no tree can keep them apart, every method that measures
    raises `TooComplexError` once ``work`` is used up.
    """

    def __init__(self, vertices: FloatArray, faces: IntArray, *, work: float = WORK) -> None:
        """Build the tree.

        Args:
            vertices: (v, 3) finite coordinates; those no face uses are ignored.
            faces: (f, 3) vertex indices, at least one face.
            work: nodes and leaves of the tree that all queries together may look into; infinity is no limit.
        """
        vertices, faces = kernel_array(vertices, np.float64), kernel_array(faces, np.int32)
        if faces.shape[0] == 0:
            raise ValueError("a surface needs at least one face")
        self._axes = tree_axes(vertices, faces)
        turned = self._turn(vertices)
        nodes, children, lanes, coincide = _built(turned, faces)
        if coincide:  # many times the same triangle, perhaps: once will do
            distinct = np.flatnonzero(distinct_faces(duplicate_vertex_map(vertices), faces))
            if len(distinct) < len(faces):
                nodes, children, lanes, _ = _built(turned, faces[distinct])
                lanes = distinct[lanes].astype(np.int32)
        self.tree = Tree(
            nodes,
            children,
            np.zeros(len(lanes) * ROWS),
            lanes,
            turned,
            faces,
            np.array([work_at_first(work), work]),
            ROUNDING * float(np.abs(turned).max()),
        )

    @property
    def work_left(self) -> float:
        """Nodes and leaves that queries may still look into; negative once it is used up."""
        return float(self.tree.left[1])

    def require_work(self) -> None:
        """Pass when all that was found is exact. To be called after kernels that use `tree`.

        Raises:
            TooComplexError: the work is used up, and what was measured last is not.
        """
        if self.work_left <= 0.0:
            raise TooComplexError(
                "The mesh is too complex: so many of its faces cross or crowd each other that distances to it cannot "
                "be measured in the time a request may take. Send its outer surface alone, or a simplified mesh."
            )

    def closest(self, points: FloatArray, bound: float = np.inf) -> tuple[FloatArray, FloatArray, IntArray]:
        """The closest point of the surface to each point.

        Args:
            points: (n, 3) finite coordinates.
            bound: surface at this distance or farther is not looked for.

        Returns:
            (n, 3) closest points, (n,) squared distances, (n,) int32 face indices; NaN, infinity and -1 where there is
            no surface within the bound.
        """
        turned = self._turn(kernel_array(points, np.float64))
        squared, lanes, _ = self._search(turned, bound * bound, np.inf)
        found = np.empty((len(turned), 3))
        closest_points(turned, lanes, self.tree, found)
        if self._axes is not None:
            found = self.from_tree(found)
        return found, squared, np.where(lanes >= 0, self.tree.owners[lanes], np.int32(-1))

    def squared_distances(self, points: FloatArray) -> FloatArray:
        """(n,) squared distances of (n, 3) points from the surface."""
        return self._search(self._turn(kernel_array(points, np.float64)), np.inf, np.inf)[0]

    def within(self, points: FloatArray, distance: float) -> BoolArray:
        """(n,) whether (n, 3) points have any surface within a distance: much cheaper than how far it is."""
        turned = self._turn(kernel_array(points, np.float64))
        found = np.empty(len(turned), dtype=np.bool_)
        search_within(turned, morton_order(turned), distance * distance, self.tree, found)
        self.require_work()
        return found

    def mean_squared_distance(self, points: FloatArray, stop_above: float = np.inf) -> float:
        """Mean squared distance of (n, 3) points: the symmetry error, when they are transformed surface samples.

        Returns infinity as soon as the sum over a part of the points proves the mean to exceed ``stop_above``, and the
        exact mean otherwise.
        """
        count = len(points)
        if count == 0:
            raise ValueError("the mean needs at least one point")
        total = self._search(self._turn(kernel_array(points, np.float64)), np.inf, stop_above * count)[2]
        return np.inf if total > stop_above * count else total / count

    def to_tree(self, vectors: FloatArray) -> FloatArray:
        """A copy of points or directions (n, 3) in the axes of the tree, which may be turned about the origin."""
        return np.array(vectors, dtype=np.float64, order="C") if self._axes is None else turned(vectors, self._axes)

    def from_tree(self, vectors: FloatArray) -> FloatArray:
        """Points or directions (n, 3) back in the frame of the surface."""
        return vectors if self._axes is None else turned(vectors, self._axes.T)

    def _turn(self, points: FloatArray) -> FloatArray:
        """Into the axes of the tree."""
        return points if self._axes is None else turned(points, self._axes)

    def _search(self, points: FloatArray, bound: float, stop_above: float) -> tuple[FloatArray, AnyArray, float]:
        squared = np.empty(len(points))
        lanes = np.empty(len(points), dtype=np.int64)
        total = search(
            points,
            morton_order(points),
            self.tree,
            float(bound),
            float(stop_above),
            squared,
            lanes,
        )
        self.require_work()
        return squared, lanes, total


def _built(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray, IntArray, bool]:
    """Boxes, children and owners as in ``_bvh.Tree``, and whether many triangles had one centre."""
    boxes, owners, crowd = references(vertices, faces)
    if crowd or len(faces) <= _FEW:  # split down to the leaves: that takes longer, and queries look into fewer nodes
        nodes, children, order, cells, coincide = split(boxes.copy(), LANES)
    else:
        order, cells, cell_boxes, coincide = sort_into_cells(boxes)
        nodes, children, numbers, leaves, _ = split(cell_boxes, 1)
        cells = cells[numbers[leaves[:, 0]]]
    return *with_cells(boxes, owners, order, cells, nodes, children), coincide
