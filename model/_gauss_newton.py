"""The inner loop of refinement: one robust Gauss-Newton step for every operation of a batch."""

import numpy as np

from model._jit import jit, jit_allocating
from model.types import FloatArray


@jit_allocating
def steps(
    samples: FloatArray,
    images: FloatArray,
    closest: FloatArray,
    squared: FloatArray,
    normals: FloatArray,
    linear: FloatArray,
    scales: FloatArray,
    shrink: float,
    smallest: float,
    spread: float,
    quantile: float,
    contact: float,
    damping: float,
    result: FloatArray,
) -> None:
    """Fill ``result`` ``(k, 6)`` with the motions (turn, shift) of all elements, and update ``scales`` ``(k,)``.

    Args:
        samples: ``(n, 3)``.
        images: ``(k, n, 3)`` of the samples.
        closest: ``(k, n, 3)`` points of the surface.
        squared: ``(k, n)`` squared distances.
        normals: ``(k, n, 3)`` of the faces hit, used where an image touches the surface.
        linear: ``(k, 3, 3)`` linear parts of the operations.
        scales: ``(k,)`` robust scales of the step before.
        shrink: factor by which a scale falls at least ...
        smallest: ... but not below this,
        spread: nor below so many times
        quantile: this quantile of the distances.
        contact: a distance smaller than this has no direction.
        damping: of the normal equations, relative to their trace.
        result: see above.
    """
    count, size = squared.shape
    ordered = np.empty(size)
    row = np.empty(6)
    matrix = np.empty((6, 6))
    for k in range(count):
        for i in range(size):
            ordered[i] = np.sqrt(squared[k, i])
        ordered.sort()
        typical = spread * ordered[min(int(quantile * size), size - 1)]
        scale = max(min(scales[k] * shrink, max(typical, smallest)), smallest)
        scales[k] = scale
        matrix[:] = 0.0
        for a in range(6):
            result[k, a] = 0.0
        for i in range(size):
            distance = np.sqrt(squared[k, i])
            x, y, z = images[k, i, 0], images[k, i, 1], images[k, i, 2]
            if distance < contact:
                mx, my, mz = normals[k, i, 0], normals[k, i, 1], normals[k, i, 2]
            else:
                mx = (x - closest[k, i, 0]) / distance
                my = (y - closest[k, i, 1]) / distance
                mz = (z - closest[k, i, 2]) / distance
            # R^T m
            bx = linear[k, 0, 0] * mx + linear[k, 1, 0] * my + linear[k, 2, 0] * mz
            by = linear[k, 0, 1] * mx + linear[k, 1, 1] * my + linear[k, 2, 1] * mz
            bz = linear[k, 0, 2] * mx + linear[k, 1, 2] * my + linear[k, 2, 2] * mz
            qx, qy, qz = samples[i, 0], samples[i, 1], samples[i, 2]
            row[0] = (y * mz - z * my) - (qy * bz - qz * by)
            row[1] = (z * mx - x * mz) - (qz * bx - qx * bz)
            row[2] = (x * my - y * mx) - (qx * by - qy * bx)
            row[3], row[4], row[5] = mx - bx, my - by, mz - bz
            ratio = distance / scale
            weight = 1.0 / ((1.0 + ratio * ratio) * (1.0 + ratio * ratio))
            for a in range(6):
                weighted = weight * row[a]
                result[k, a] -= weighted * distance
                for b in range(a + 1):
                    matrix[a, b] += weighted * row[b]
        trace = 0.0
        for a in range(6):
            trace += matrix[a, a]
        for a in range(6):
            matrix[a, a] += damping * trace + 1e-12
        _solve(matrix, result, k)


@jit
def _solve(matrix: FloatArray, vectors: FloatArray, k: int) -> None:
    """Cholesky: overwrite ``vectors[k]`` with the solution; ``matrix`` (6, 6), lower triangle, is destroyed."""
    for a in range(6):
        for b in range(a + 1):
            total = matrix[a, b]
            for c in range(b):
                total -= matrix[a, c] * matrix[b, c]
            matrix[a, b] = np.sqrt(max(total, 1e-300)) if a == b else total / matrix[b, b]
    for a in range(6):
        total = vectors[k, a]
        for c in range(a):
            total -= matrix[a, c] * vectors[k, c]
        vectors[k, a] = total / matrix[a, a]
    for a in range(5, -1, -1):
        total = vectors[k, a]
        for c in range(a + 1, 6):
            total -= matrix[c, a] * vectors[k, c]
        vectors[k, a] = total / matrix[a, a]


@jit
def linear_parts(
    directions: FloatArray, cosines: FloatArray, sines: FloatArray, along: FloatArray, result: FloatArray
) -> None:
    """See `model.operations.linear_parts`: ``along`` multiplies the component along the direction."""
    for k in range(result.shape[0]):
        x, y, z = directions[k, 0], directions[k, 1], directions[k, 2]
        c, s = cosines[k], sines[k]
        f = along[k] - c
        result[k, 0, 0], result[k, 0, 1], result[k, 0, 2] = c + f * x * x, f * x * y - s * z, f * x * z + s * y
        result[k, 1, 0], result[k, 1, 1], result[k, 1, 2] = f * x * y + s * z, c + f * y * y, f * y * z - s * x
        result[k, 2, 0], result[k, 2, 1], result[k, 2, 2] = f * x * z - s * y, f * y * z + s * x, c + f * z * z


@jit
def images(points: FloatArray, own: int, fixed: FloatArray, linear: FloatArray, result: FloatArray) -> None:
    """Images of ``points`` ``(1, n, 3)``, or ``(k, n, 3)`` with ``own`` 1: ``R (p - f) + f`` for every operation."""
    for k in range(result.shape[0]):
        fx, fy, fz = fixed[k, 0], fixed[k, 1], fixed[k, 2]
        for i in range(result.shape[1]):
            x, y, z = points[k * own, i, 0] - fx, points[k * own, i, 1] - fy, points[k * own, i, 2] - fz
            for a in range(3):
                result[k, i, a] = linear[k, a, 0] * x + linear[k, a, 1] * y + linear[k, a, 2] * z
            result[k, i, 0] += fx
            result[k, i, 1] += fy
            result[k, i, 2] += fz
