"""How far a symmetry operation takes a surface from itself: deviations, and which of them say something.

The deviation of an operation T at a surface point x is the distance of T(x) from the surface. Where T(x) lies beyond
an open boundary, nobody knows what was there: x is missing its counterpart, which is no argument against T. Where T(x)
lies off a surface that is there, it is.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from model.geometry.frames import along_segments, face_normals
from model.geometry.operations import Operations
from model.geometry.refinement import squared_distances
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.geometry.topology import open_edges
from model.search.facets import Facets
from model.types import BoolArray, FloatArray, IntArray

_PROBE = 5e-4
"""How far beyond an edge surface is looked for, unit frame."""

_CLOSED = 0.6
"""Surface within this part of the probe's length closes the edge."""

_ON_EDGE = 1e-7
_PLAUSIBLE_SHARE, _PLAUSIBLE_DISTANCE = 0.3, 0.03
_SIDEWAYS = 0.5
"""The way from an open boundary to a point beyond it lies mostly along the surface: its cosine to it at least."""

_ONE_SIDED = 0.25
"""Length of the mean normal, weighted by area, above which a surface was seen from one side only. It is 0 for a closed
surface and some 0.5 for a depth image."""


@dataclass(frozen=True, slots=True, eq=False)
class Deviations:
    """Of k operations on n samples: ``squared`` deviations ``(k, n)`` and where the counterpart is ``missing``."""

    squared: FloatArray
    missing: BoolArray

    @property
    def rms(self) -> FloatArray:
        """RMS deviation over the samples whose counterpart is not missing, ``(k,)``; infinite where none is there."""
        there = ~self.missing
        count = there.sum(1)
        total = np.where(there, self.squared, 0.0).sum(1)
        return np.sqrt(np.divide(total, count, out=np.full(len(total), np.inf), where=count > 0))

    @property
    def missing_share(self) -> FloatArray:
        """Share of the surface whose counterpart lies beyond an open boundary, ``(k,)``."""
        return self.missing.mean(1)

    def coverage(self, distance: float) -> FloatArray:
        """Share of the surface whose counterpart is there, no farther than ``distance``: ``(k,)``."""
        return (~self.missing & (self.squared <= distance * distance)).mean(1)

    def contradicting(self, distance: float) -> FloatArray:
        """Share of the surface that is taken farther than ``distance`` off a surface that is there: ``(k,)``."""
        return (~self.missing & (self.squared > distance * distance)).mean(1)


@dataclass(frozen=True, slots=True, eq=False)
class SurfaceSamples:
    """Points of a surface: ``points`` ``(n, 3)``, the faces ``owners`` ``(n,)`` they lie on, their unit ``normals``."""

    points: FloatArray
    owners: IntArray
    normals: FloatArray

    @classmethod
    def drawn(cls, vertices: FloatArray, faces: IntArray, count: int, seed: int) -> "SurfaceSamples":
        """``count`` points uniform on the surface (`model.geometry.sampling.sample_surface`)."""
        points, owners = sample_surface(vertices, faces, count, seed)
        return cls(points, owners, face_normals(vertices, faces[owners]))

    def every(self, stride: int) -> "SurfaceSamples":
        """Every so many-th sample."""
        return SurfaceSamples(self.points[::stride], self.owners[::stride], self.normals[::stride])

    def radius_about(self, direction: FloatArray, point: FloatArray) -> float:
        """The largest distance of a sample from the line through ``point`` ``(3,)`` along a unit ``direction``."""
        arm = self.points - point
        return float(np.sqrt(np.square(arm - np.outer(arm @ direction, direction)).sum(1).max()))

    def __len__(self) -> int:
        return len(self.points)


class DeviationMeter:
    """Measures deviations on a surface in the unit frame.

    Args:
        surface: its index.
        vertices: ``(v, 3)``, unit frame.
        faces: ``(f, 3)``.
        near: images nearer than this fit and are not asked whether they are missing.
    """

    def __init__(self, surface: SurfaceIndex, vertices: FloatArray, faces: IntArray, *, near: float) -> None:
        self.surface = surface
        self._vertices, self._faces = vertices, faces
        self.facets = Facets(vertices, faces)
        self._open = open_edges(self.facets.first, faces)
        self.closed = not self._open.any()
        self._near_squared = near * near
        self._one_sided = not self.closed and _mean_normal(vertices, faces) > _ONE_SIDED

    def measure(self, operations: Operations, samples: SurfaceSamples) -> Deviations:
        """Deviations of k operations at n samples of the surface."""
        squared = squared_distances(self.surface, samples.points, operations)
        missing = np.zeros(squared.shape, dtype=np.bool_)
        if not self.closed:
            # Where hardly any image lies near the surface, no missing part is to blame.
            plausible = np.quantile(squared, _PLAUSIBLE_SHARE, axis=1) <= _PLAUSIBLE_DISTANCE**2
            far = (squared > self._near_squared) & plausible[:, None]
            if far.any():
                images = operations.apply(samples.points)[far]
                normals = (samples.normals @ operations.matrices.transpose(0, 2, 1))[far]
                missing[far] = self.is_missing(images, normals)
        return Deviations(squared, missing)

    def is_missing(self, points: FloatArray, normals: FloatArray) -> BoolArray:
        """Which points off the surface lie where it was not seen: ``(m,)``.

        Either the closest point of the surface is on an open edge, and the way there runs along the surface or
        behind it, not away from it. Or the point is behind the closest face, and looks another way: the other side of a
        solid part one side of which is there. Of a surface seen from one side the space behind it counts as unseen too.

        Args:
            points: ``(m, 3)``, images of points of the surface.
            normals: ``(m, 3)``, the images of their normals.
        """
        closest, squared, owners = self.surface.closest(points)
        away, distance = points - closest, np.sqrt(squared)
        facing = face_normals(self._vertices, self._faces[owners])
        height = np.einsum("ij,ij->i", away, facing)
        behind = height < -0.5 * distance
        result = behind & (np.einsum("ij,ij->i", normals, facing) < 0.5)
        if self._one_sided:
            result |= behind
        sideways = away - height[:, None] * facing
        length = np.sqrt(np.square(sideways).sum(1))
        candidates = np.flatnonzero(~result & ((length > _SIDEWAYS * distance) | (height < 0.0)))
        candidates = candidates[self._on_open_edge(closest[candidates], owners[candidates])]
        if len(candidates):
            outward = sideways[candidates] / np.maximum(length[candidates, None], 1e-300)
            result[candidates] = self._goes_on_nowhere(closest[candidates], outward, facing[candidates])
        return result

    def _on_open_edge(self, points: FloatArray, owners: IntArray) -> BoolArray:
        """Which points ``(m, 3)`` of the faces ``owners`` lie on one of their open edges, or an end of one."""
        result = np.zeros(len(points), dtype=np.bool_)
        corners = self._vertices[self._faces[owners]]
        for k in range(3):
            start, end = corners[:, k], corners[:, (k + 1) % 3]
            _, squared = along_segments(points, start, end)
            result |= self._open[owners, k] & (squared < _ON_EDGE**2)
            at_corner = np.square(points - start).sum(1) < _ON_EDGE**2
            result |= at_corner & self._open_corner[self._faces[owners, k]]
        return result

    @cached_property
    def _open_corner(self) -> BoolArray:
        """Which vertices are an end of an open edge, ``(v,)``; of vertices at one place all are."""
        first = self.facets.first
        result = np.zeros(len(first), dtype=np.bool_)
        for k in range(3):
            ends = self._faces[self._open[:, k]][:, [k, (k + 1) % 3]]
            result[first[ends.ravel()]] = True
        return result[first]

    def _goes_on_nowhere(self, points: FloatArray, outward: FloatArray, normals: FloatArray) -> BoolArray:
        """Which points of open edges are no seam: beyond them, straight on or folded, no other face lies close.

        Faces that meet without sharing vertices leave open edges that are none. Where one of them stands across, it
        does so on both sides of the point; a rim that crosses a fold has it on one.
        """
        beside = 4.0 * np.cross(outward, normals)
        diagonal = 0.5**0.5
        probes = np.stack(
            [
                outward,
                (outward + normals) * diagonal,
                (outward - normals) * diagonal,
                normals + beside,
                normals - beside,
                -normals + beside,
                -normals - beside,
            ],
            axis=1,
        )
        places = points[:, None] + _PROBE * probes
        near = self.surface.squared_distances(places.reshape(-1, 3)).reshape(-1, 7) < (_CLOSED * _PROBE) ** 2
        folded = (near[:, 3] & near[:, 4]) | (near[:, 5] & near[:, 6])
        return ~(near[:, :3].any(1) | folded)


def _mean_normal(vertices: FloatArray, faces: IntArray) -> float:
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.sqrt(np.square(normals).sum(1)).sum()
    return float(np.linalg.norm(normals.sum(0)) / area) if area > 0.0 else 0.0
