"""Every vertex, edge and face of a mesh, looked at under a symmetry operation."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from model._jit import kernel_array
from model.geometry._morton import morton_order
from model.geometry.operations import Operations, linear_parts
from model.geometry.surface import SurfaceIndex
from model.search import _look_kernels as _kernels
from model.search._feature_kernels import feature_deviations
from model.search.facets import Facets
from model.types import BoolArray, FloatArray, IntArray

_MOST_FACES, _ENOUGH_FACES = 6_000, 800
_SLACK = 1.25
"""Where facets are the only disagreement, the fit that balances them adds to it."""

_ON_EDGE = 1e-6
_FIRST_LOOK, _BROKEN_ALL_OVER = 8, 0.25
"""Where so large a share of every eighth feature breaks an operation, the others are not looked at."""


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """What an operation does to m features.

    ``points`` ``(m, 3)``, the ``sagittas`` of the facets there ``(m,)``, the ``deviations`` of their images ``(m,)``,
    and where these are ``bad``, larger than the facets at both ends allow. ``images`` ``(m,)``: the vertex that each
    image coincides with, -1 for none.
    """

    points: FloatArray
    sagittas: FloatArray
    deviations: FloatArray
    bad: BoolArray
    images: IntArray

    def __add__(self, other: "Look") -> "Look":
        return Look(
            np.concatenate([self.points, other.points]),
            np.concatenate([self.sagittas, other.sagittas]),
            np.concatenate([self.deviations, other.deviations]),
            np.concatenate([self.bad, other.bad]),
            np.concatenate([self.images, other.images]),
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
        self._vertices, self._first = facets.vertices, facets.first
        stride = -(-len(facets.faces) // _MOST_FACES)
        self._chosen = np.arange(0, len(facets.faces), stride, dtype=np.int32)
        self._chosen = self._chosen[morton_order(surface.to_tree(self._middles(self._chosen)))]

    def look(self, operation: Operations, stride: int = 1) -> Look:
        """What one operation (a batch of one) does to the features; to part of them where that says enough.

        A face whose corners go to the corners of a face is there as a whole, and so is an edge; only of others the
        middles are looked at.

        Args:
            operation: the one.
            stride: of the faces every so many-th.
        """
        few = self._chosen[:: max(stride, _FIRST_LOOK)]
        first = self._at_vertices(self._corners_of(few), operation) + self._at_faces(few, operation)
        if first.bad.mean() > _BROKEN_ALL_OVER:
            return first
        if first.bad.any():  # it is not exact, and where it breaks shows on part of the faces
            stride = max(stride, len(self._chosen) // _ENOUGH_FACES)
        chosen = self._chosen[::stride]
        corners = self._corners_of(chosen)
        whole = self._at_vertices(corners, operation)
        image = np.full(len(self._vertices), -1, dtype=np.int32)
        image[corners] = whole.images
        left = chosen[~self._facets.edges.are_faces(image[self._first[self._facets.faces[chosen]]])]
        if not len(left):
            return whole
        return whole + self._at_edges(left, image, operation) + self._at_faces(left, operation)

    def measure(self, points: FloatArray, sagittas: FloatArray, operation: Operations) -> Look:
        """What an operation does to some points ``(m, 3)`` of the surface with sagittas ``(m,)``."""
        surface = self._surface
        deviations, allowed = np.empty(len(points)), np.empty(len(points))
        images = np.empty(len(points), dtype=np.int32)
        linear = linear_parts(surface.to_tree(operation.directions), operation.angles, operation.improper)
        feature_deviations(
            surface.to_tree(points),
            kernel_array(sagittas, np.float64),
            surface.to_tree(operation.points)[0],
            linear[0],
            _SLACK,
            self._allowed,
            _ON_EDGE**2,
            *self._tables,
            surface.tree,
            deviations,
            allowed,
            images,
        )
        surface.require_work()
        return Look(points, sagittas, deviations, deviations > allowed, images)

    @cached_property
    def _tables(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """What the kernel has to know: vertices at one place, and sagittas."""
        of_face, at_vertex = self._facets.sagittas
        return kernel_array(self._first, np.int32), kernel_array(of_face, np.float64), at_vertex

    def _middles(self, faces: IntArray) -> FloatArray:
        middles = np.empty((len(faces), 3))
        of_all = kernel_array(self._facets.faces, np.int32)
        _kernels.middles_of_faces(kernel_array(self._vertices, np.float64), of_all, faces, middles)
        return middles

    def _corners_of(self, faces: IntArray) -> IntArray:
        """The vertices of some faces, each once, in the order in which the faces have them."""
        corners = np.empty(3 * len(faces), dtype=np.int32)
        of_all, first = kernel_array(self._facets.faces, np.int32), kernel_array(self._first, np.int32)
        return corners[: _kernels.corners_of_faces(first, of_all, faces, corners)]

    def _at_vertices(self, corners: IntArray, operation: Operations) -> Look:
        return self.measure(self._vertices[corners], self._facets.sagittas[1][corners], operation)

    def _at_faces(self, faces: IntArray, operation: Operations) -> Look:
        return self.measure(self._middles(faces), self._facets.sagittas[0][faces], operation)

    def _at_edges(self, faces: IntArray, image: IntArray, operation: Operations) -> Look:
        """At the middles of edges that do not go to an edge, by the ``image`` of each vertex ``(v,)``."""
        ends = np.empty((3 * len(faces), 2), dtype=np.int32)
        of_all, first = kernel_array(self._facets.faces, np.int32), kernel_array(self._first, np.int32)
        _kernels.ends_of_edges(first, of_all, faces, ends)
        kept = np.empty(len(ends), dtype=np.int32)
        kept = kept[: _kernels.different_edges(ends, self._facets.edges.are_edges(image[ends]), kept)]
        middles, least = np.empty((len(kept), 3)), np.empty(len(kept))
        vertices, at_vertex = kernel_array(self._vertices, np.float64), self._facets.sagittas[1]
        _kernels.middles_of_edges(vertices, ends, kept, kernel_array(at_vertex, np.float64), middles, least)
        return self.measure(middles, least, operation)
