"""Coarse scan: every direction of the hemisphere is tried as a mirror plane and as a two-fold axis, on a voxel grid.

Scores are mean squared distances of images of occupied voxels from the occupied voxels, cut off at a few voxels: a
lookup instead of a search, some thousand times cheaper than the exact distance and just good enough to start from.
Equal voxels count equally however many faces lie in them, so that doubled faces do not disturb the scan.
"""

from functools import cached_property, lru_cache

import numpy as np

from model._jit import kernel_array
from model.geometry import _scan_kernels as _kernels
from model.geometry.operations import Operations
from model.types import AnyArray, BoolArray, ByteArray, FloatArray

DIRECTIONS = 1000
"""Neighbours are 4.5 degrees apart; half of that moves a point at the rim by about a voxel of a 32 grid."""

POINTS = 128
TRUNCATION_RADIUS = 3
"""Distances are cut off at so many voxels: what is missing on the other side counts as that far."""

NEAR = 2.0
"""Cut-off of `DistanceGrid.interpolated_error`, in voxels: beyond it a part is missing, at any distance."""

_SETTLING_STEPS, _SETTLING_SCALES = 6, (2.0, 0.7)
_DAMPING, _LARGEST_TURN, _LARGEST_SHIFT = 1e-6, 0.15, 2.0
"""Of one step of `DistanceGrid.settle`; turns in radians, shifts in voxels."""

_NEIGHBOURS = 8


class DistanceGrid:
    """Squared distance from the nearest occupied voxel, in voxels, truncated; and points to look up.

    ``centre`` ``(3,)`` is the mean of the occupied voxels and ``points`` ``(p, 3)`` some of them, evenly picked, in the
    frame of the grid: that of `voxelize`.
    """

    def __init__(self, occupied: BoolArray, points: int = POINTS) -> None:
        """Build from an ``(R, R, R)`` grid with at least one occupied voxel."""
        self.resolution = occupied.shape[0]
        self.squared = _truncated_squares(occupied)
        # A third of the time of argwhere on three axes.
        filled = np.column_stack(np.unravel_index(np.flatnonzero(occupied), occupied.shape))
        coordinates = (filled + 0.5) / self.resolution - 0.5
        self.centre: FloatArray = coordinates.mean(0)
        count = min(points, len(filled))
        self.points: FloatArray = np.ascontiguousarray(coordinates[np.arange(count) * len(filled) // count])

    def scan(self, most_mirrored: float = np.inf, most_turned: float = np.inf) -> tuple[FloatArray, FloatArray]:
        """Scores of all `directions` as normals of planes, and as two-fold axes, through the centre: ``(D,)`` each.

        Those larger than what is asked for, ``most_mirrored`` and ``most_turned``, may be said to be less than they
        are, but still larger.
        """
        mirrored, turned = np.empty(DIRECTIONS), np.empty(DIRECTIONS)
        centre, squared = self._cells(self.centre), self.squared.ravel()
        _kernels.scan(
            directions(),
            self._columns,
            centre,
            squared,
            len(self.squared),
            most_mirrored,
            most_turned,
            mirrored,
            turned,
        )
        return mirrored, turned

    def scan_planes(self, offsets: FloatArray, most: float = np.inf) -> FloatArray:
        """Scores of all `directions` as normals of planes at offsets ``(m, D)``, ``n . x + offset = 0``: ``(m, D)``.

        Those larger than ``most`` may be said to be less than they are, but still larger.
        """
        result, normals = np.empty(offsets.shape), directions()
        shifted = kernel_array(self.resolution * offsets - self._cells(np.zeros(3)) @ normals.T, np.float64)
        _kernels.scan_planes(normals, shifted, self._columns, self.squared.ravel(), len(self.squared), most, result)
        return result

    def score(self, operations: Operations, most: float = np.inf) -> FloatArray:
        """Mean squared distances, in voxels, of the points' images under operations in the grid's frame: ``(k,)``.

        Those larger than ``most`` may be said to be less than they are, but still larger.
        """
        result = np.empty(len(operations))
        _kernels.score(
            self._columns,
            kernel_array(operations.directions, np.float64),
            kernel_array(self._cells(operations.points), np.float64),
            kernel_array(operations.angles, np.float64),
            operations.improper,
            self.squared.ravel(),
            len(self.squared),
            most,
            result,
        )
        return result

    @cached_property
    def _columns(self) -> FloatArray:
        """The points in cells, ``(3, p)``."""
        return np.ascontiguousarray(self._cells(self.points).T)

    def interpolated_error(self, operations: Operations) -> FloatArray:
        """Mean squared distances, in voxels, of the points' images, interpolated between cells: ``(k,)``.

        Slower and finer than `score`: it tells planes apart that differ by a degree. Cut off at ``NEAR``.
        """
        result = np.empty(len(operations))
        points, fixed = (kernel_array(self._cells(p) - 0.5, np.float64) for p in (self.points, operations.points))
        distances = self.distances.ravel()
        _kernels.interpolated_error(points, fixed, operations.matrices, distances, len(self.squared), NEAR, result)
        return result

    def settle(self, operations: Operations) -> Operations:
        """Operations moved to where the points' images come nearest to occupied voxels: as exact as voxels can say.

        A thousand times faster than `model.geometry.refinement.refine`, which goes on from there.
        """
        directions = np.array(operations.directions, dtype=np.float64, order="C")
        places = np.array(self._cells(operations.points) - 0.5, dtype=np.float64, order="C")
        _kernels.settle(
            kernel_array(self._cells(self.points) - 0.5, np.float64),
            directions,
            places,
            kernel_array(operations.angles, np.float64),
            np.where(operations.improper, -1.0, 1.0),
            self.distances.ravel(),
            len(self.squared),
            TRUNCATION_RADIUS - 0.5,
            *_SETTLING_SCALES,
            _SETTLING_STEPS,
            _DAMPING,
            _LARGEST_TURN,
            _LARGEST_SHIFT,
        )
        points = (places + 0.5 - TRUNCATION_RADIUS) / self.resolution - 0.5
        return Operations(directions, points, operations.angles, operations.improper)

    @cached_property
    def distances(self) -> AnyArray:
        """Not squared, float32, of the shape of ``squared``."""
        return np.sqrt(self.squared, dtype=np.float32)

    def _cells(self, points: FloatArray) -> FloatArray:
        return (points + 0.5) * self.resolution + TRUNCATION_RADIUS


@lru_cache(maxsize=1)
def directions() -> FloatArray:
    """``(DIRECTIONS, 3)`` unit vectors spread evenly over a hemisphere (Fibonacci lattice)."""
    index = np.arange(DIRECTIONS) + 0.5
    z = 1.0 - index / DIRECTIONS
    radius = np.sqrt(1.0 - z * z)
    angle = np.pi * (1.0 + 5.0**0.5) * index
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])


@lru_cache(maxsize=1)
def _neighbours() -> AnyArray:
    """``(DIRECTIONS, 8)`` nearest other directions, opposite ones being the same."""
    cosines = np.abs(directions() @ directions().T)
    np.fill_diagonal(cosines, -1.0)
    return np.ascontiguousarray(np.argsort(-cosines, axis=1)[:, :_NEIGHBOURS])


def minima(scores: FloatArray, count: int, largest: float = np.inf) -> FloatArray:
    """Directions no neighbour of which scores better, ``(m, 3)``: the best ``count`` up to a ``largest`` score."""
    return directions()[lowest(scores, count, largest)]


def lowest(scores: FloatArray, count: int, largest: float) -> AnyArray:
    """The same as indices of `directions`: ``(m,)``."""
    found = np.empty(DIRECTIONS, dtype=np.int64)
    candidates = found[: _kernels.lowest(kernel_array(scores, np.float64), _neighbours(), largest, found)]
    return candidates[np.argsort(scores[candidates], kind="stable")][:count]


def _truncated_squares(occupied: BoolArray) -> ByteArray:
    """Squared distances to the nearest occupied voxel, truncated, in a grid padded by ``TRUNCATION_RADIUS``.

    One axis after the other, on the flat array: a shift that leaves a row ends in the padding of the next, which is
    empty along the axis at hand. The sums stay contiguous and take a fifth of the time of those on the three axes.
    """
    size = len(occupied) + 2 * TRUNCATION_RADIUS
    padded = np.full((size, size, size), TRUNCATION_RADIUS * TRUNCATION_RADIUS, dtype=np.uint8)
    inner = slice(TRUNCATION_RADIUS, -TRUNCATION_RADIUS)
    padded[inner, inner, inner][occupied] = 0
    squared = padded.ravel()
    for stride in (1, size, size * size):
        before = squared.copy()
        for shift in range(1, TRUNCATION_RADIUS):
            step, cost = shift * stride, np.uint8(shift * shift)
            np.minimum(squared[step:], before[:-step] + cost, out=squared[step:])
            np.minimum(squared[:-step], before[step:] + cost, out=squared[:-step])
    return padded
