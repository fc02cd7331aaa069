"""Loops over the points of a `model.geometry.scan.DistanceGrid`; lengths are in cells of its padded grid."""

import numpy as np

from model._jit import jit, jit_allocating
from model.geometry._operation_kernels import advance, linear_part
from model.types import AnyArray, FloatArray, IntArray


@jit
def scan(
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
def score(
    points: FloatArray, fixed: FloatArray, linear: FloatArray, squared: IntArray, size: int, result: FloatArray
) -> None:
    """``result`` ``(k,)`` of images ``R (p - f) + f`` in the padded grid of ``size`` cells a side, in cells."""
    last = size - 1.0
    for k in range(linear.shape[0]):
        fx, fy, fz = fixed[k, 0], fixed[k, 1], fixed[k, 2]
        total = 0
        for i in range(points.shape[0]):
            px, py, pz = points[i, 0] - fx, points[i, 1] - fy, points[i, 2] - fz
            x = min(max(linear[k, 0, 0] * px + linear[k, 0, 1] * py + linear[k, 0, 2] * pz + fx, 0.0), last)
            y = min(max(linear[k, 1, 0] * px + linear[k, 1, 1] * py + linear[k, 1, 2] * pz + fy, 0.0), last)
            z = min(max(linear[k, 2, 0] * px + linear[k, 2, 1] * py + linear[k, 2, 2] * pz + fz, 0.0), last)
            total += squared[(int(x) * size + int(y)) * size + int(z)]
        result[k] = total / points.shape[0]


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
    """``result`` ``(k,)`` of images ``R (p - f) + f`` in the padded grid, whole numbers being the middle of cells.

    Distances are cut off at ``near``.
    """
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
            cell = (a * size + b) * size + c
            beyond = cell + across
            d00 = distances[cell] + z * (distances[cell + 1] - distances[cell])
            d01 = distances[cell + size] + z * (distances[cell + size + 1] - distances[cell + size])
            d10 = distances[beyond] + z * (distances[beyond + 1] - distances[beyond])
            d11 = distances[beyond + size] + z * (distances[beyond + size + 1] - distances[beyond + size])
            d0, d1 = d00 + y * (d01 - d00), d10 + y * (d11 - d10)
            distance = min(d0 + x * (d1 - d0), near)
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
    largest_turn: float,
    largest_shift: float,
) -> None:
    """Gauss-Newton of `model.geometry.refinement` on distances interpolated between cells; lengths in cells.

    ``directions`` and ``places`` ``(k, 3)`` are overwritten. Turns are about the middle of the grid. Images farther
    than ``near`` have no say, others the less the larger their distance is beside a scale that falls step by step.
    """
    across, last, middle = size * size, size - 1.001, 0.5 * (size - 1.0)
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
                a, b, c = int(x), int(y), int(z)
                x, y, z = x - a, y - b, z - c
                near_cell = (a * size + b) * size + c
                far_cell = near_cell + across
                v000, v001 = distances[near_cell], distances[near_cell + 1]
                v010, v011 = distances[near_cell + size], distances[near_cell + size + 1]
                v100, v101 = distances[far_cell], distances[far_cell + 1]
                v110, v111 = distances[far_cell + size], distances[far_cell + size + 1]
                d00, d01 = v000 + z * (v001 - v000), v010 + z * (v011 - v010)
                d10, d11 = v100 + z * (v101 - v100), v110 + z * (v111 - v110)
                d0, d1 = d00 + y * (d01 - d00), d10 + y * (d11 - d10)
                distance = d0 + x * (d1 - d0)
                if distance >= near:
                    continue
                mx, my = d1 - d0, (1.0 - x) * (d01 - d00) + x * (d11 - d10)
                mz = (1.0 - x) * ((1.0 - y) * (v001 - v000) + y * (v011 - v010)) + x * (
                    (1.0 - y) * (v101 - v100) + y * (v111 - v110)
                )
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
            advance(directions, places, k, matrix, twist, largest_turn, largest_shift)
        for a in range(3):
            places[k, a] += middle
