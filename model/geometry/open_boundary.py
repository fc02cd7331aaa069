"""Where a surface ends without having been seen to end: its open boundary, and which points lie beyond it."""

from functools import cached_property

import numpy as np

from model.geometry import _boundary_kernels as _kernels
from model.geometry.edges import EdgeTable
from model.geometry.integrals import mean_normal
from model.geometry.normals import face_normals
from model.geometry.operations import Operations, linear_parts
from model.geometry.surface import SurfaceIndex
from model.types import AnyArray, BoolArray, ByteArray, FloatArray, IntArray

_PROBE = 5e-4
"""How far beyond an edge surface is looked for, unit frame."""

_CLOSED = 0.6
"""Surface within this part of the probe's length closes the edge."""

_ON_EDGE = 1e-7
_PLAUSIBLE_SHARE, _PLAUSIBLE_DISTANCE = 0.3, 0.03
"""Where fewer images lie near the surface, no missing part is to blame."""

_SIDEWAYS = 0.5
"""The way from an open boundary to a point beyond it lies mostly along the surface: its cosine to it at least."""

_ONE_SIDED = 0.25
"""Length of the mean normal, weighted by area, above which a surface was seen from one side only. It is 0 for a closed
surface and some 0.5 for a depth image."""

_TURN = 0.25
"""Sine of the angle by which a rim turns at a corner at least to be called ragged there."""


class OpenBoundary:
    """The open edges of a surface in the unit frame, and what they say about points off it.

    ``is_empty``: there are none. ``one_sidedness``: length of the mean normal, weighted by area; 0 without open edges.

    Args:
        surface: its index.
        vertices: ``(v, 3)``, unit frame.
        faces: ``(f, 3)``.
        first: for every vertex the first one at its place, ``(v,)``.
        edges: of the mesh.
    """

    def __init__(
        self, surface: SurfaceIndex, vertices: FloatArray, faces: IntArray, first: IntArray, edges: EdgeTable
    ) -> None:
        self._surface = surface
        self.is_empty = not edges.has_open
        self.one_sidedness = 0.0
        if self.is_empty:
            return
        self._edges = edges.open
        self._rims = _rims(self._edges, faces, first)
        self.one_sidedness = mean_normal(vertices, faces)
        self._normals = face_normals(surface.tree.vertices, faces)
        is_end = np.zeros(len(first), dtype=np.bool_)
        is_end[self._rims] = True
        self._ends: BoolArray = is_end[first]  # of vertices at one place all are

    @cached_property
    def raggedness(self) -> float:
        """Share of the length of all rims that zigzags, turning one way at one end of an edge and back at the other.

        What was torn off a mesh, or not seen by a scanner, leaves such rims; whoever means a surface to end draws
        straight ones and curves. 0 without open edges.
        """
        if self.is_empty:
            return 0.0
        ends = self._rims
        # Of a corner where two open edges meet, the far end of the other one is known from the sum of both.
        count = np.bincount(ends.ravel())
        total = np.bincount(ends.ravel(), ends[:, ::-1].ravel()).astype(np.int64)
        simple = (count[ends] == 2).all(1)
        ends, every = ends[simple], self._lengths(ends).sum()
        before, behind = (total[ends[:, k]] - ends[:, 1 - k] for k in range(2))
        vertices = self._surface.tree.vertices
        way = [vertices[ends[:, 0]] - vertices[before], vertices[ends[:, 1]] - vertices[ends[:, 0]]]
        way = [_unit(part) for part in [*way, vertices[behind] - vertices[ends[:, 1]]]]
        turns = [np.cross(way[k], way[k + 1]) for k in range(2)]
        sharp = np.minimum(*(np.square(turn).sum(1) for turn in turns)) > _TURN**2
        ragged = sharp & ((turns[0] * turns[1]).sum(1) < 0.0)
        return float(self._lengths(ends[ragged]).sum() / every) if every > 0.0 else 0.0

    def _lengths(self, ends: AnyArray) -> FloatArray:
        vertices = self._surface.tree.vertices
        return np.linalg.norm(vertices[ends[:, 1]] - vertices[ends[:, 0]], axis=1)

    def distances(
        self, points: FloatArray, normals: FloatArray, operations: Operations, near: float
    ) -> tuple[FloatArray, ByteArray]:
        """Squared distances of images from the surface, and why it was not seen where they lie: ``(k, n)`` both.

        `SEEN`, if it was; the others are in `model.geometry._boundary_kernels`.

        Either the closest point of the surface is on an open edge, and the way there runs along the surface or
        behind it, not away from it. Or the image is behind the closest face, and looks another way: the other side of
        a solid part one side of which is there. Of a surface seen from one side the space behind it counts as unseen
        too.

        Args:
            points: ``(n, 3)`` of the surface.
            normals: ``(n, 3)`` of the surface there.
            operations: k of them.
            near: images nearer than this are not asked.
        """
        surface = self._surface
        squared = np.empty((len(operations), len(points)))
        unseen = np.zeros(squared.shape, dtype=np.uint8)
        linear = linear_parts(surface.to_tree(operations.directions), operations.angles, operations.improper)
        _kernels.find_missing(
            surface.to_tree(points),
            surface.to_tree(normals),
            surface.to_tree(operations.points),
            linear,
            near * near,
            _PLAUSIBLE_DISTANCE**2,
            _PLAUSIBLE_SHARE,
            self.one_sidedness > _ONE_SIDED,
            _SIDEWAYS,
            _ON_EDGE**2,
            _PROBE,
            (_CLOSED * _PROBE) ** 2,
            self._normals,
            self._edges,
            self._ends,
            surface.tree,
            squared,
            unseen,
        )
        surface.require_work()
        return squared, unseen


def _rims(edges: BoolArray, faces: IntArray, first: IntArray) -> AnyArray:
    """The ends of open edges, ``(e, 2)`` int64: of vertices at one place the first."""
    face, side = np.nonzero(edges)
    return first[np.stack([faces[face, side], faces[face, (side + 1) % 3]], axis=1)].astype(np.int64)


def _unit(vectors: FloatArray) -> FloatArray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-300)
