"""Coarse scan: every direction of the hemisphere is tried as a mirror plane and as a two-fold axis, on a voxel grid.

Scores are mean squared distances of images of occupied voxels from the occupied voxels, cut off at a few voxels: a
lookup instead of a search, some thousand times cheaper than the exact distance and just good enough to start from.
Equal voxels count equally however many faces lie in them, so that doubled faces do not disturb the scan.
"""

from functools import cached_property, lru_cache

import numpy as np

from model._jit import jit, kernel_array
from model.geometry.operations import Operations
from model.types import AnyArray, BoolArray, FloatArray, IntArray

DIRECTIONS = 1000
"""Neighbours are 4.5 degrees apart; half of that moves a point at the rim by about a voxel of a 32 grid."""

POINTS = 128
TRUNCATION_RADIUS = 3
"""Distances are cut off at so many voxels: what is missing on the other side counts as that far."""

NEAR = 2.0
"""Cut-off of `DistanceGrid.interpolated_error`, in voxels: beyond it a part is missing, at any distance."""

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

    @cached_property
    def scan(self) -> tuple[FloatArray, FloatArray]:
        """Scores of all `directions` as normals of planes, and as two-fold axes, through the centre: ``(D,)`` each."""
        mirrored, turned = np.empty(DIRECTIONS), np.empty(DIRECTIONS)
        points = np.ascontiguousarray(self._cells(self.points).T)
        centre = self._cells(self.centre)
        _scan(directions(), points, centre, self.squared.ravel(), len(self.squared), mirrored, turned)
        return mirrored, turned

    def score(self, images: FloatArray) -> FloatArray:
        """Mean squared distances, in voxels, of images ``(..., n, 3)``: ``(...)``."""
        size = len(self.squared)
        cells = np.clip(self._cells(images), 0.0, size - 1.0).astype(np.int64)
        return self.squared.ravel()[(cells[..., 0] * size + cells[..., 1]) * size + cells[..., 2]].mean(-1)

    def interpolated_error(self, operations: Operations) -> FloatArray:
        """Mean squared distances, in voxels, of the points' images, interpolated between cells: ``(k,)``.

        Slower and finer than `score`: it tells planes apart that differ by a degree. Cut off at ``NEAR``.
        """
        result = np.empty(len(operations))
        points, fixed = (kernel_array(self._cells(p) - 0.5, np.float64) for p in (self.points, operations.points))
        _interpolated_error(points, fixed, operations.matrices, self.distances.ravel(), len(self.squared), result)
        return result

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
    return np.argsort(-cosines, axis=1)[:, :_NEIGHBOURS]


def minima(scores: FloatArray, count: int, largest: float = np.inf) -> FloatArray:
    """Directions no neighbour of which scores better, ``(m, 3)``: the best ``count`` up to a ``largest`` score."""
    lowest = np.flatnonzero((scores <= scores[_neighbours()].min(1)) & (scores <= largest))
    return directions()[lowest[np.argsort(scores[lowest], kind="stable")][:count]]


@jit
def _scan(
    normals: FloatArray,
    points: FloatArray,
    centre: FloatArray,
    squared: IntArray,
    size: int,
    mirrored: FloatArray,
    turned: FloatArray,
) -> None:
    """Scores in the padded grid of ``size`` cells a side, points ``(3, p)`` and centre in cells.

    A turn by pi is the reflection across the same direction, inverted: both cost one projection. The 32-bit integers
    and the points in columns are for the vector unit: three times faster than without.
    """
    cx, cy, cz = centre[0], centre[1], centre[2]
    zero, last, side = np.int32(0), np.int32(size - 1), np.int32(size)
    count = points.shape[1]
    for k in range(normals.shape[0]):
        nx, ny, nz = normals[k, 0], normals[k, 1], normals[k, 2]
        total_mirrored, total_turned = np.int32(0), np.int32(0)
        for i in range(count):
            x, y, z = points[0, i] - cx, points[1, i] - cy, points[2, i] - cz
            twice = 2.0 * (x * nx + y * ny + z * nz)
            x, y, z = x - twice * nx, y - twice * ny, z - twice * nz
            # Beyond the padding everything is as far as on its rim.
            a = min(max(np.int32(cx + x), zero), last)
            b = min(max(np.int32(cy + y), zero), last)
            c = min(max(np.int32(cz + z), zero), last)
            total_mirrored += squared[(a * side + b) * side + c]
            a = min(max(np.int32(cx - x), zero), last)
            b = min(max(np.int32(cy - y), zero), last)
            c = min(max(np.int32(cz - z), zero), last)
            total_turned += squared[(a * side + b) * side + c]
        mirrored[k] = total_mirrored / count
        turned[k] = total_turned / count


@jit
def _interpolated_error(
    points: FloatArray, fixed: FloatArray, linear: FloatArray, distances: AnyArray, size: int, result: FloatArray
) -> None:
    """``result`` ``(k,)`` of images ``R (p - f) + f`` in the padded grid, whole numbers being the middle of cells."""
    across, last = size * size, size - 1.001
    for k in range(linear.shape[0]):
        fx, fy, fz = fixed[k, 0], fixed[k, 1], fixed[k, 2]
        total = 0.0
        for i in range(points.shape[0]):
            px, py, pz = points[i, 0] - fx, points[i, 1] - fy, points[i, 2] - fz
            x = min(max(linear[k, 0, 0] * px + linear[k, 0, 1] * py + linear[k, 0, 2] * pz + fx, 0.0), last)
            y = min(max(linear[k, 1, 0] * px + linear[k, 1, 1] * py + linear[k, 1, 2] * pz + fy, 0.0), last)
            z = min(max(linear[k, 2, 0] * px + linear[k, 2, 1] * py + linear[k, 2, 2] * pz + fz, 0.0), last)
            a, b, c = int(x), int(y), int(z)
            x, y, z = x - a, y - b, z - c
            near = (a * size + b) * size + c
            far = near + across
            d00 = distances[near] + z * (distances[near + 1] - distances[near])
            d01 = distances[near + size] + z * (distances[near + size + 1] - distances[near + size])
            d10 = distances[far] + z * (distances[far + 1] - distances[far])
            d11 = distances[far + size] + z * (distances[far + size + 1] - distances[far + size])
            d0, d1 = d00 + y * (d01 - d00), d10 + y * (d11 - d10)
            distance = min(d0 + x * (d1 - d0), NEAR)
            total += distance * distance
        result[k] = total / points.shape[0]


def _truncated_squares(occupied: BoolArray) -> IntArray:
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
    return padded.astype(np.int32)
