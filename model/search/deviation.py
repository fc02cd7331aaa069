"""How far a symmetry operation takes a surface from itself: deviations, and which of them say something.

The deviation of an operation T at a surface point x is the distance of T(x) from the surface. Where T(x) lies beyond
an open boundary, nobody knows what was there: x is missing its counterpart, which is no argument against T. Where T(x)
lies off a surface that is there, it is.
"""

from dataclasses import dataclass

import numpy as np

from model.geometry._boundary_kernels import SEEN
from model.geometry._morton import morton_order
from model.geometry.normals import face_normals
from model.geometry.open_boundary import OpenBoundary
from model.geometry.operations import Operations
from model.geometry.refinement import squared_distances
from model.geometry.sampling import SurfaceSampler
from model.geometry.surface import SurfaceIndex
from model.search.facets import Facets
from model.types import BoolArray, ByteArray, FloatArray, IntArray

_TORN = 0.03
"""Part of the rims of an open surface that zigzags, above which something may have been torn off."""

_MOST_KEPT = 2_500
"""Deviations of one measurement that are kept."""


@dataclass(frozen=True, slots=True, eq=False)
class Deviations:
    """Of k operations on n samples: ``squared`` deviations ``(k, n)``, and why the counterpart was ``unseen``."""

    squared: FloatArray
    unseen: ByteArray

    @property
    def missing(self) -> BoolArray:
        """Where the counterpart was not seen, ``(k, n)``."""
        return self.unseen != SEEN

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

    @property
    def as_is(self) -> FloatArray:
        """RMS deviation over all samples, as if nothing were missing, ``(k,)``."""
        return np.sqrt(self.squared.mean(1))

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
    def drawn(cls, sampler: SurfaceSampler, count: int, seed: int) -> "SurfaceSamples":
        """``count`` points uniform on a surface."""
        points, owners = sampler.draw(count, seed)
        order = morton_order(points)  # neighbours find their images in the same leaves
        points, owners = points[order], owners[order]
        return cls(points, owners, face_normals(sampler.vertices, sampler.faces[owners]))

    def every(self, stride: int) -> "SurfaceSamples":
        """Every so many-th sample."""
        return SurfaceSamples(self.points[::stride], self.owners[::stride], self.normals[::stride])

    def radius_about(self, direction: FloatArray, point: FloatArray) -> float:
        """The largest distance of a sample from the line through ``point`` ``(3,)`` along a unit ``direction``."""
        arm = self.points - point
        return float(np.sqrt(np.square(arm - np.outer(arm @ direction, direction)).sum(1).max()))

    @property
    def key(self) -> tuple[object, ...]:
        """What tells these samples from all others that exist."""
        return self.points.__array_interface__["data"][0], *self.points.strides, len(self.points)

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
        self.facets = Facets(vertices, faces)
        self._boundary = OpenBoundary(surface, vertices, faces, self.facets.first, self.facets.edges)
        self._near = near
        self._known: dict[tuple[object, ...], tuple[FloatArray, Deviations]] = {}

    @property
    def closed(self) -> bool:
        """Whether the surface has no open edge."""
        return self._boundary.is_empty

    @property
    def one_sidedness(self) -> float:
        """Length of the mean normal of an open surface, some 0.5 for a depth image; 0 for a closed one."""
        return self._boundary.one_sidedness

    @property
    def raggedness(self) -> float:
        """See `OpenBoundary`."""
        return self._boundary.raggedness

    @property
    def is_torn(self) -> bool:
        """Whether rims zigzag, as where something was torn off; else the surface ends as somebody drew it."""
        return self.raggedness > _TORN

    def telling(self, deviations: Deviations) -> BoolArray:
        """Which deviations say something of two operations that are compared, ``(k, n)``.

        What was torn off says nothing for either. Where a surface ends as it was drawn, an image beyond its end does.
        """
        return ~deviations.missing if self.is_torn else np.ones(deviations.missing.shape, dtype=np.bool_)

    def measure(self, operations: Operations, samples: SurfaceSamples) -> Deviations:
        """Deviations of k operations at n samples of the surface; unless they are many they are kept, to be told again.

        The arrays are not to be written to.
        """
        if len(operations) * len(samples) > _MOST_KEPT:
            return self._measured(operations, samples)
        key = (*operations.key, *samples.key)
        if key not in self._known:  # while the samples are kept, no others are where they are
            self._known[key] = samples.points, self._measured(operations, samples)
        return self._known[key][1]

    def noise(self, operations: Operations, samples: SurfaceSamples) -> FloatArray:
        """The part of the RMS deviations that is noise, ``(k,)``: what changes from one sample to its neighbour.

        Where two shapes differ, the ways from neighbouring images to the surface are alike; in noise each goes its own
        way. The median of how much they change, squared, is the variance of noise, whatever a part of the surface does.
        """
        images = operations.apply(samples.points)
        ways = images - self.surface.closest(images.reshape(-1, 3))[0].reshape(images.shape)
        there = ~self.measure(operations, samples).missing
        changes = np.square(np.diff(ways, axis=1)).sum(2)  # samples are in Morton order
        changes[~(there[:, 1:] & there[:, :-1])] = np.nan
        return np.array([float(np.sqrt(np.nanmedian(row))) if np.isfinite(row).any() else 0.0 for row in changes])

    def _measured(self, operations: Operations, samples: SurfaceSamples) -> Deviations:
        if self.closed:
            squared = squared_distances(self.surface, samples.points, operations)
            return Deviations(squared, np.zeros(squared.shape, dtype=np.uint8))
        return Deviations(*self._boundary.distances(samples.points, samples.normals, operations, self._near))
