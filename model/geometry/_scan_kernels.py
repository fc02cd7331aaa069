"""Loops over the points of a `model.geometry.scan.DistanceGrid`; lengths are in cells of its padded grid."""

import numpy as np

from model._jit import jit, jit_allocating, jit_inlined
from model.geometry._operation_kernels import advance, linear_part
from model.types import AnyArray, BoolArray, ByteArray, FloatArray

_AT_A_TIME = 32
"""Points that are looked up before it is asked whether the rest matters."""


@jit_inlined
def _squared_at(squared: ByteArray, side: np.int32, x: float, y: float, z: float) -> int:
    """Of the cell that a place is in; beyond the padding everything is as far as on its rim."""
    zero, last = np.int32(0), np.int32(side - 1)
    a = min(max(np.int32(x), zero), last)
    b = min(max(np.int32(y), zero), last)
    c = min(max(np.int32(z), zero), last)
    return squared[(a * side + b) * side + c]


@jit
def scan(
    normals: FloatArray,
    points: FloatArray,
    centre: FloatArray,
    squared: ByteArray,
    size: int,
    most_mirrored: float,
    most_turned: float,
    mirrored: FloatArray,
    turned: FloatArray,
) -> None:
    """Scores in the padded grid of ``size`` cells a side, points ``(3, p)`` and centre in cells.

    A turn by pi is the reflection across the same direction, inverted: both cost one projection. The 32-bit integers
    and the points in columns are for the vector unit: three times faster than without. Where both scores are known to
    be larger than ``most_mirrored`` and ``most_turned``, how much larger is not found out.
    """
    cx, cy, cz = centre[0], centre[1], centre[2]
    side = np.int32(size)
    count = points.shape[1]
    for k in range(normals.shape[0]):
        nx, ny, nz = normals[k, 0], normals[k, 1], normals[k, 2]
        total_mirrored, total_turned = np.int32(0), np.int32(0)
        for first in range(0, count, _AT_A_TIME):
            for i in range(first, min(first + _AT_A_TIME, count)):
                x, y, z = points[0, i] - cx, points[1, i] - cy, points[2, i] - cz
                twice = 2.0 * (x * nx + y * ny + z * nz)
                x, y, z = x - twice * nx, y - twice * ny, z - twice * nz
                total_mirrored += _squared_at(squared, side, cx + x, cy + y, cz + z)
                total_turned += _squared_at(squared, side, cx - x, cy - y, cz - z)
            if total_mirrored > most_mirrored * count and total_turned > most_turned * count:
                break
        mirrored[k] = total_mirrored / count
        turned[k] = total_turned / count


@jit
def scan_planes(
    normals: FloatArray,
    offsets: FloatArray,
    points: FloatArray,
    squared: ByteArray,
    size: int,
    most: float,
    result: FloatArray,
) -> None:
    """``result`` ``(m, k)`` of mirror planes with normals ``(k, 3)`` at offsets ``(m, k)``; otherwise as `scan`."""
    side = np.int32(size)
    count = points.shape[1]
    for m in range(offsets.shape[0]):
        for k in range(normals.shape[0]):
            nx, ny, nz, offset = normals[k, 0], normals[k, 1], normals[k, 2], offsets[m, k]
            total = np.int32(0)
            for first in range(0, count, _AT_A_TIME):
                for i in range(first, min(first + _AT_A_TIME, count)):
                    x, y, z = points[0, i], points[1, i], points[2, i]
                    twice = 2.0 * (x * nx + y * ny + z * nz + offset)
                    total += _squared_at(squared, side, x - twice * nx, y - twice * ny, z - twice * nz)
                if total > most * count:
                    break
            result[m, k] = total / count


@jit
def lowest(scores: FloatArray, neighbours: AnyArray, largest: float, found: AnyArray) -> int:
    """Fill ``found`` with the places whose score is up to ``largest`` and no neighbour's is lower: how many."""
    count = 0
    for k in range(scores.shape[0]):
        score = scores[k]
        if not score <= largest:
            continue
        best = True
        for j in range(neighbours.shape[1]):
            if scores[neighbours[k, j]] < score:
                best = False
                break
        if best:
            found[count] = k
            count += 1
    return count


@jit
def _image(
    points: FloatArray, i: int, fixed: FloatArray, linear: FloatArray, k: int, last: float
) -> tuple[float, float, float]:
    """The image ``R (p - f) + f`` of a point under operation ``k``; beyond the padding all is as far as on its rim."""
    fx, fy, fz = fixed[k, 0], fixed[k, 1], fixed[k, 2]
    px, py, pz = points[i, 0] - fx, points[i, 1] - fy, points[i, 2] - fz
    x = linear[k, 0, 0] * px + linear[k, 0, 1] * py + linear[k, 0, 2] * pz + fx
    y = linear[k, 1, 0] * px + linear[k, 1, 1] * py + linear[k, 1, 2] * pz + fy
    z = linear[k, 2, 0] * px + linear[k, 2, 1] * py + linear[k, 2, 2] * pz + fz
    return min(max(x, 0.0), last), min(max(y, 0.0), last), min(max(z, 0.0), last)


@jit
def _interpolated(distances: AnyArray, size: int, x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """The distance at a place, whole numbers being the middle of cells, and its gradient."""
    a, b, c = int(x), int(y), int(z)
    x, y, z = x - a, y - b, z - c
    cell = (a * size + b) * size + c
    beyond = cell + size * size
    z00, z01 = distances[cell + 1] - distances[cell], distances[cell + size + 1] - distances[cell + size]
    z10, z11 = distances[beyond + 1] - distances[beyond], distances[beyond + size + 1] - distances[beyond + size]
    d00, d01 = distances[cell] + z * z00, distances[cell + size] + z * z01
    d10, d11 = distances[beyond] + z * z10, distances[beyond + size] + z * z11
    d0, d1 = d00 + y * (d01 - d00), d10 + y * (d11 - d10)
    return (
        d0 + x * (d1 - d0),
        d1 - d0,
        (1.0 - x) * (d01 - d00) + x * (d11 - d10),
        (1.0 - x) * ((1.0 - y) * z00 + y * z01) + x * ((1.0 - y) * z10 + y * z11),
    )


@jit_allocating
def score(
    points: FloatArray,
    directions: FloatArray,
    places: FloatArray,
    angles: FloatArray,
    improper: BoolArray,
    squared: ByteArray,
    size: int,
    most: float,
    result: FloatArray,
) -> None:
    """``result`` ``(k,)`` of the images of points ``(3, p)`` in the padded grid of ``size`` cells a side, in cells.

    The operations are given as in `model.geometry.operations.Operations`, in the axes of the grid, their points
    ``places`` in cells. What is larger than ``most`` may be said to be less than it is.
    """
    linear = np.empty((1, 3, 3))
    side = np.int32(size)
    count = points.shape[1]
    for k in range(directions.shape[0]):
        along = -1.0 if improper[k] else 1.0
        linear_part(directions[k, 0], directions[k, 1], directions[k, 2], angles[k], along, 0, linear)
        fx, fy, fz = places[k, 0], places[k, 1], places[k, 2]
        xx, xy, xz = linear[0, 0, 0], linear[0, 0, 1], linear[0, 0, 2]
        yx, yy, yz = linear[0, 1, 0], linear[0, 1, 1], linear[0, 1, 2]
        zx, zy, zz = linear[0, 2, 0], linear[0, 2, 1], linear[0, 2, 2]
        total = np.int32(0)
        for first in range(0, count, _AT_A_TIME):
            for i in range(first, min(first + _AT_A_TIME, count)):
                px, py, pz = points[0, i] - fx, points[1, i] - fy, points[2, i] - fz
                x = xx * px + xy * py + xz * pz + fx
                y = yx * px + yy * py + yz * pz + fy
                z = zx * px + zy * py + zz * pz + fz
                total += _squared_at(squared, side, x, y, z)
            if total > most * count:
                break
        result[k] = total / count


@jit
def interpolated_error(
    points: FloatArray,
    fixed: FloatArray,
    linear: FloatArray,
    distances: AnyArray,
    size: int,
    near: float,
    result: FloatArray,
) -> None:
    """``result`` ``(k,)`` of the images of points in the padded grid, whole numbers being the middle of cells.

    Distances are cut off at ``near``.
    """
    for k in range(linear.shape[0]):
        total = 0.0
        for i in range(points.shape[0]):
            x, y, z = _image(points, i, fixed, linear, k, size - 1.001)
            distance = min(_interpolated(distances, size, x, y, z)[0], near)
            total += distance * distance
        result[k] = total / points.shape[0]


@jit_allocating
def settle(
    points: FloatArray,
    directions: FloatArray,
    places: FloatArray,
    angles: FloatArray,
    along: FloatArray,
    distances: AnyArray,
    size: int,
    near: float,
    first_scale: float,
    last_scale: float,
    steps: int,
    damping: float,
    largest_turn: float,
    largest_shift: float,
) -> None:
    """Gauss-Newton of `model.geometry.refinement` on distances interpolated between cells; lengths in cells.

    ``directions`` and ``places`` ``(k, 3)`` are overwritten. Turns are about the middle of the grid. Images farther
    than ``near`` have no say, others the less the larger their distance is beside a scale that falls step by step.
    """
    last, middle = size - 1.001, 0.5 * (size - 1.0)
    linear, matrix, twist, row = np.empty((1, 3, 3)), np.empty((6, 6)), np.empty(6), np.empty(6)
    for k in range(directions.shape[0]):
        for a in range(3):
            places[k, a] -= middle
        for step in range(steps):
            scale = first_scale * (last_scale / first_scale) ** (step / max(steps - 1.0, 1.0))
            linear_part(directions[k, 0], directions[k, 1], directions[k, 2], angles[k], along[k], 0, linear)
            matrix[:] = 0.0
            twist[:] = 0.0
            for i in range(points.shape[0]):
                qx, qy, qz = points[i, 0] - middle, points[i, 1] - middle, points[i, 2] - middle
                px, py, pz = qx - places[k, 0], qy - places[k, 1], qz - places[k, 2]
                ix = linear[0, 0, 0] * px + linear[0, 0, 1] * py + linear[0, 0, 2] * pz + places[k, 0]
                iy = linear[0, 1, 0] * px + linear[0, 1, 1] * py + linear[0, 1, 2] * pz + places[k, 1]
                iz = linear[0, 2, 0] * px + linear[0, 2, 1] * py + linear[0, 2, 2] * pz + places[k, 2]
                x = min(max(ix + middle, 0.0), last)
                y = min(max(iy + middle, 0.0), last)
                z = min(max(iz + middle, 0.0), last)
                distance, mx, my, mz = _interpolated(distances, size, x, y, z)
                if distance >= near:
                    continue
                bx = linear[0, 0, 0] * mx + linear[0, 1, 0] * my + linear[0, 2, 0] * mz
                by = linear[0, 0, 1] * mx + linear[0, 1, 1] * my + linear[0, 2, 1] * mz
                bz = linear[0, 0, 2] * mx + linear[0, 1, 2] * my + linear[0, 2, 2] * mz
                row[0] = (iy * mz - iz * my) - (qy * bz - qz * by)
                row[1] = (iz * mx - ix * mz) - (qz * bx - qx * bz)
                row[2] = (ix * my - iy * mx) - (qx * by - qy * bx)
                row[3], row[4], row[5] = mx - bx, my - by, mz - bz
                ratio = distance / scale
                weight = 1.0 / ((1.0 + ratio * ratio) * (1.0 + ratio * ratio))
                for a in range(6):
                    weighted = weight * row[a]
                    twist[a] -= weighted * distance
                    for b in range(a + 1):
                        matrix[a, b] += weighted * row[b]
            advance(directions, places, k, k + 1, matrix, twist, damping, largest_turn, largest_shift)
        for a in range(3):
            places[k, a] += middle
