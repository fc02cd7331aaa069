"""Every vertex, edge and face of a mesh, looked at under a symmetry operation."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from model._jit import kernel_array
from model.geometry._morton import morton_order
from model.geometry.operations import Operations, linear_parts
from model.geometry.surface import SurfaceIndex
from model.search import _look_kernels as _kernels
from model.search._coincidence_kernels import bound_distances, find_coinciding, mark_places
from model.search._feature_kernels import feature_deviations
from model.search.facets import Facets
from model.types import BoolArray, FloatArray, IntArray

_MOST_FACES, _ENOUGH_FACES = 6_000, 800
_SLACK = 1.25
"""Where facets are the only disagreement, the fit that balances them adds to it."""

_ON_EDGE = 1e-6
_CERTAIN = 0.5
"""What deviates by less than this part of what is allowed need not be measured."""

_AS_LARGE = 1e-13
"""Deviations are told apart by more than this, unit frame."""

_FIRST_BATCH = 8
_NONE = np.empty(0)
_FIRST_LOOK, _BROKEN_ALL_OVER = 8, 0.25
"""Where so large a share of every eighth feature breaks an operation, the others are not looked at."""


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """What an operation does to m features.

    ``points`` ``(m, 3)``, the ``deviations`` of their images ``(m,)``, and where these are ``bad``, larger than the
    facets at both ends allow; there, the ``sagittas`` of the facets ``(m,)``. ``images`` ``(m,)``: the vertex that each
    image coincides with, -1 for none. Where ``bounded``, a deviation is no more than said, and certainly not bad.
    """

    points: FloatArray
    sagittas: FloatArray
    deviations: FloatArray
    bad: BoolArray
    images: IntArray
    bounded: BoolArray

    def __add__(self, other: "Look") -> "Look":
        return Look(
            np.concatenate([self.points, other.points]),
            np.concatenate([self.sagittas, other.sagittas]),
            np.concatenate([self.deviations, other.deviations]),
            np.concatenate([self.bad, other.bad]),
            np.concatenate([self.images, other.images]),
            np.concatenate([self.bounded, other.bounded]),
        )


class Features:
    """The vertices, middles of edges and of faces of a mesh in the unit frame; of a large one some of them.

    Args:
        surface: its index.
        facets: the mesh.
        allowed: what every feature may deviate by, besides what facets leave open.
    """

    def __init__(self, surface: SurfaceIndex, facets: Facets, allowed: float) -> None:
        self._surface, self._facets, self._allowed = surface, facets, allowed
        self._vertices = kernel_array(facets.vertices, np.float64)
        self._first, self._faces = kernel_array(facets.first, np.int32), kernel_array(facets.faces, np.int32)
        stride = -(-len(facets.faces) // _MOST_FACES)
        chosen = np.arange(0, len(facets.faces), stride, dtype=np.int32)
        self._chosen = chosen[morton_order(surface.to_tree(self._middles(chosen)))]
        numbers = np.full(len(self._vertices), -1, dtype=np.int32)
        corners = np.empty(3 * len(chosen), dtype=np.int32)
        self._rows = np.empty((len(chosen), 3), dtype=np.int32)
        count = _kernels.corners_of_faces(self._first, self._faces, self._chosen, numbers, corners, self._rows)
        self._corners = corners[:count]

    def look(self, operation: Operations, stride: int = 1) -> Look:
        """What one operation (a batch of one) does to the features; to part of them where that says enough.

        A face whose corners go to the corners of a face is there as a whole, and so is an edge; only of others the
        middles are looked at. What an image certainly is no farther from than it may be is not measured.

        Args:
            operation: the one.
            stride: of the faces every so many-th.
        """
        coinciding = self._coinciding(operation)
        few = slice(None, None, max(stride, _FIRST_LOOK))
        first = self._at_vertices(self._rows_of(few), operation, *coinciding)
        beside = self._facets.edges.faces_at(coinciding[0][self._rows[few]])
        first += self._at_faces(self._chosen[few], operation, beside)
        if first.bad.mean() > _BROKEN_ALL_OVER:
            return first
        if first.bad.any():  # it is not exact, and where it breaks shows on part of the faces
            stride = max(stride, len(self._chosen) // _ENOUGH_FACES)
        chosen, rows = self._chosen[::stride], self._rows[::stride]
        corners = self._rows_of(slice(None, None, stride))
        look = self._at_vertices(corners, operation, *coinciding)
        image = np.full(len(self._corners), -1, dtype=np.int32)
        image[corners] = look.images
        left = ~self._facets.edges.are_faces(image[rows])
        if left.any():
            beside = None if first.bad.any() else self._facets.edges.faces_at(image[rows[left]])
            look += self._at_edges(rows[left], image, beside, operation)
            look += self._at_faces(chosen[left], operation, beside)
        return self._with_largest(look, operation)

    def measure(self, points: FloatArray, sagittas: FloatArray, operation: Operations) -> Look:
        """What an operation does to some points ``(m, 3)`` of the surface with sagittas ``(m,)``."""
        return self._measured(points, lambda: sagittas, operation)

    def _measured(self, points: FloatArray, sagittas: Callable[[], FloatArray], operation: Operations) -> Look:
        """``sagittas`` ``(m,)`` are asked for where that matters: all faces have to be looked at for them."""
        surface, count, facets = self._surface, len(points), self._facets
        deviations, allowed, images = np.empty(count), np.empty(count), np.empty(count, dtype=np.int32)
        fixed, linear = self._of_tree(operation)
        inside = surface.to_tree(points)

        def go_on(begin: int, own: FloatArray, of_face: FloatArray, at_vertex: FloatArray) -> int:
            return feature_deviations(
                begin,
                inside,
                own,
                fixed,
                linear,
                _SLACK,
                self._allowed,
                _ON_EDGE**2,
                self._first,
                of_face,
                at_vertex,
                surface.tree,
                deviations,
                allowed,
                images,
            )

        done, own = 0, _NONE
        if not facets.are_sagittas_known:
            done = go_on(0, _NONE, _NONE, _NONE)
        if done < count:
            own = kernel_array(sagittas(), np.float64)
            done = go_on(done, own, *facets.sagittas)
        surface.require_work()
        found = own if len(own) else np.zeros(count)
        return Look(points, found, deviations, deviations > allowed, images, np.zeros(count, dtype=np.bool_))

    def _known(
        self,
        points: FloatArray,
        sagittas: Callable[[], FloatArray],
        operation: Operations,
        bounds: FloatArray,
        images: IntArray | None = None,
    ) -> Look:
        """What is certain by ``bounds`` of the deviations ``(m,)``, and all others measured."""
        bounded = bounds <= _CERTAIN * self._allowed
        if not bounded.any():
            return self._measured(points, sagittas, operation)
        left = np.flatnonzero(~bounded)
        found, bad = np.zeros(len(points)), np.zeros(len(points), dtype=np.bool_)
        images = np.full(len(points), -1, dtype=np.int32) if images is None else images
        look = Look(points, found, bounds, bad, images, bounded)
        if len(left):
            measured = self._measured(points[left], lambda: sagittas()[left], operation)
            found[left], bounds[left], bad[left] = measured.sagittas, measured.deviations, measured.bad
            images[left] = measured.images
        return look

    def _with_largest(self, look: Look, operation: Operations) -> Look:
        """With the largest deviation that is not bad measured, and all bounds above it lowered to it."""
        left = np.flatnonzero(look.bounded)
        if not len(left):
            return look
        measured = look.deviations[~look.bounded & ~look.bad]
        largest, batch = float(measured.max(initial=0.0)), _FIRST_BATCH
        left = left[np.argsort(-look.deviations[left], kind="stable")]
        deviations, bounded = look.deviations.copy(), look.bounded.copy()
        while len(left) and deviations[left[0]] > largest + _AS_LARGE:
            few, left, batch = left[:batch], left[batch:], 4 * batch
            deviations[few] = self.measure(look.points[few], np.zeros(len(few)), operation).deviations
            bounded[few] = False
            largest = max(largest, float(deviations[few].max()))
        deviations[left] = np.minimum(deviations[left], largest)
        return replace(look, deviations=deviations, bounded=bounded)

    def _coinciding(self, operation: Operations) -> tuple[IntArray, FloatArray]:
        """The vertex that each corner's image coincides with, -1 for none, and how far apart they are."""
        images, gaps = np.empty(len(self._corners), dtype=np.int32), np.empty(len(self._corners))
        points, vertices = self._corner_points, self._surface.tree.vertices
        find_coinciding(points, *self._of_tree(operation), vertices, self._places, self._allowed, images, gaps)
        return images, gaps

    def _of_tree(self, operation: Operations) -> tuple[FloatArray, FloatArray]:
        """A fixed point and the linear part of an operation in the axes of the tree."""
        to_tree = self._surface.to_tree
        linear = linear_parts(to_tree(operation.directions), operation.angles, operation.improper)
        return to_tree(operation.points)[0], linear[0]

    @cached_property
    def _corner_points(self) -> FloatArray:
        """In the axes of the tree."""
        return self._surface.tree.vertices[self._corners]

    @cached_property
    def _places(self) -> BoolArray:
        places = np.zeros(len(self._vertices), dtype=np.bool_)
        mark_places(self._first, self._faces, places)
        return places

    def _middles(self, faces: IntArray) -> FloatArray:
        middles = np.empty((len(faces), 3))
        _kernels.middles_of_faces(self._vertices, self._faces, faces, middles)
        return middles

    def _rows_of(self, some: slice) -> IntArray:
        """The corners of some of the chosen faces, each once, in the order in which the faces have them."""
        rows = np.ascontiguousarray(self._rows[some])
        result = np.empty(rows.size, dtype=np.int32)
        return result[: _kernels.each_once(rows, np.zeros(len(self._corners), dtype=np.bool_), result)]

    def _at_vertices(self, rows: IntArray, operation: Operations, images: IntArray, gaps: FloatArray) -> Look:
        corners = self._corners[rows]

        def sagittas() -> FloatArray:
            return self._facets.sagittas[1][corners]

        return self._known(self._vertices[corners], sagittas, operation, gaps[rows], images[rows])

    def _at_faces(self, faces: IntArray, operation: Operations, beside: IntArray | None) -> Look:
        middles = self._middles(faces)

        def sagittas() -> FloatArray:
            return self._facets.sagittas[0][faces]

        return self._known(middles, sagittas, operation, self._bounds(middles, beside, operation))

    def _at_edges(self, rows: IntArray, image: IntArray, beside: IntArray | None, operation: Operations) -> Look:
        """At the middles of edges that do not go to an edge, by the ``image`` of each corner."""
        ends = np.empty((3 * len(rows), 2), dtype=np.int32)
        _kernels.ends_of_edges(rows, ends)
        kept = np.empty(len(ends), dtype=np.int32)
        kept = kept[: _kernels.different_edges(ends, self._facets.edges.are_edges(image[ends]), kept)]
        middles = np.empty((len(kept), 3))
        _kernels.middles_of_edges(self._vertices, self._corners, ends, kept, middles)

        def sagittas() -> FloatArray:
            of_ends = self._facets.sagittas[1][self._corners[ends[kept]]]
            return np.minimum(of_ends[:, 0], of_ends[:, 1])

        return self._known(
            middles,
            sagittas,
            operation,
            self._bounds(middles, None if beside is None else beside[kept // 3], operation),
        )

    def _bounds(self, points: FloatArray, beside: IntArray | None, operation: Operations) -> FloatArray:
        """What images of points ``(m, 3)`` deviate by at most, by some faces near them ``(m, k)``; infinite without."""
        if beside is None:
            return np.full(len(points), np.inf)
        surface, bounds = self._surface, np.empty(len(points))
        fixed, linear = self._of_tree(operation)
        tree = surface.tree
        bound_distances(surface.to_tree(points), fixed, linear, beside, tree.vertices, tree.faces, bounds)
        return bounds
