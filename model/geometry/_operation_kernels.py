"""What refinement and judgement spend their time in: images of samples, their distances, Gauss-Newton steps.

Everything is in the axes of the tree.
"""

import numpy as np

from model._jit import jit, jit_allocating
from model.geometry._bvh import LANES, Tree, scratch
from model.geometry._bvh_frames import closest_on, normal_of
from model.geometry._bvh_query import nearest
from model.types import FloatArray


@jit
def linear_part(x: float, y: float, z: float, angle: float, along: float, k: int, result: FloatArray) -> None:
    """Fill ``result[k]``: turn by ``angle`` about (x, y, z), multiply the component along it by ``along``."""
    c, s = np.cos(angle), np.sin(angle)
    f = along - c
    result[k, 0, 0], result[k, 0, 1], result[k, 0, 2] = c + f * x * x, f * x * y - s * z, f * x * z + s * y
    result[k, 1, 0], result[k, 1, 1], result[k, 1, 2] = f * x * y + s * z, c + f * y * y, f * y * z - s * x
    result[k, 2, 0], result[k, 2, 1], result[k, 2, 2] = f * x * z - s * y, f * y * z + s * x, c + f * z * z


@jit
def linear_parts(directions: FloatArray, angles: FloatArray, along: FloatArray, result: FloatArray) -> None:
    """The same for a batch: ``result`` ``(k, 3, 3)``."""
    for k in range(result.shape[0]):
        linear_part(directions[k, 0], directions[k, 1], directions[k, 2], angles[k], along[k], k, result)


@jit
def images(points: FloatArray, fixed: FloatArray, linear: FloatArray, result: FloatArray) -> None:
    """``result`` ``(k, n, 3)``: images ``R (p - f) + f`` of points ``(n, 3)`` under every operation."""
    for k in range(result.shape[0]):
        fx, fy, fz = fixed[k, 0], fixed[k, 1], fixed[k, 2]
        for i in range(result.shape[1]):
            x, y, z = points[i, 0] - fx, points[i, 1] - fy, points[i, 2] - fz
            for a in range(3):
                result[k, i, a] = linear[k, a, 0] * x + linear[k, a, 1] * y + linear[k, a, 2] * z + fixed[k, a]


@jit
def image_of(point: FloatArray, fixed: FloatArray, linear: FloatArray, image: FloatArray) -> None:
    """``image`` ``(3,)``: ``R (p - f) + f`` of one point under one operation."""
    for a in range(3):
        image[a] = fixed[a]
        for b in range(3):
            image[a] += linear[a, b] * (point[b] - fixed[b])


@jit_allocating
def image_distances(
    samples: FloatArray,
    fixed: FloatArray,
    linear: FloatArray,
    tree: Tree,
    squared: FloatArray,
) -> None:
    """Fill ``squared`` ``(k, n)`` with the squared distances of the images of all samples from the surface."""
    paper = scratch()
    seed = 0
    for k in range(squared.shape[0]):
        fx, fy, fz = fixed[k, 0], fixed[k, 1], fixed[k, 2]
        for i in range(squared.shape[1]):
            x, y, z = samples[i, 0] - fx, samples[i, 1] - fy, samples[i, 2] - fz
            squared[k, i], lane = nearest(
                linear[k, 0, 0] * x + linear[k, 0, 1] * y + linear[k, 0, 2] * z + fx,
                linear[k, 1, 0] * x + linear[k, 1, 1] * y + linear[k, 1, 2] * z + fy,
                linear[k, 2, 0] * x + linear[k, 2, 1] * y + linear[k, 2, 2] * z + fz,
                seed,
                np.inf,
                tree,
                paper,
            )
            seed = lane // LANES


@jit_allocating
def refine(
    samples: FloatArray,
    directions: FloatArray,
    points: FloatArray,
    angles: FloatArray,
    along: FloatArray,
    together: int,
    steps: int,
    first_scale: float,
    final_scale: float,
    shrink: float,
    spread: float,
    quantile: float,
    trust_rms: bool,
    damping: float,
    contact: float,
    largest_turn: float,
    largest_shift: float,
    step_tolerance: float,
    roughly: float,
    tree: Tree,
) -> None:
    """Gauss-Newton until nothing moves; ``directions`` and ``points`` ``(k, 3)`` are overwritten.

    With ``together`` 0 every operation moves by itself. Else the first ``together`` operations are fitted with one
    motion, and the rows after them are carried along: the axes and the centre of the frame they belong to.

    See `model.geometry.refinement` for the method and what the constants mean.
    """
    paper = scratch()
    count = samples.shape[0]
    width = max(together, 1)
    blocks = 1 if together > 0 else directions.shape[0]
    # Where the image of each sample was found last: the best place to begin.
    seeds = np.zeros((width, count), dtype=np.int64)
    distances, ordered = np.empty((width, count)), np.empty(width * count)
    image, gradients = np.empty((width, count, 3)), np.empty((width, count, 3))
    linear = np.empty((width, 3, 3))
    matrix, twist, row = np.empty((6, 6)), np.empty(6), np.empty(6)
    for block in range(blocks):
        scale = first_scale / shrink
        for _ in range(steps):
            total = 0.0
            for j in range(width):
                k = block + j
                linear_part(directions[k, 0], directions[k, 1], directions[k, 2], angles[k], along[k], j, linear)
                fx, fy, fz = points[k, 0], points[k, 1], points[k, 2]
                for i in range(count):
                    qx, qy, qz = samples[i, 0] - fx, samples[i, 1] - fy, samples[i, 2] - fz
                    x = linear[j, 0, 0] * qx + linear[j, 0, 1] * qy + linear[j, 0, 2] * qz + fx
                    y = linear[j, 1, 0] * qx + linear[j, 1, 1] * qy + linear[j, 1, 2] * qz + fy
                    z = linear[j, 2, 0] * qx + linear[j, 2, 1] * qy + linear[j, 2, 2] * qz + fz
                    squared, lane = nearest(
                        x,
                        y,
                        z,
                        seeds[j, i],
                        np.inf,
                        tree,
                        paper,
                    )
                    seeds[j, i] = lane // LANES
                    distance = np.sqrt(squared)
                    if distance < contact:
                        mx, my, mz = normal_of(lane, tree)
                    else:
                        cx, cy, cz = closest_on(x, y, z, lane, tree)
                        mx, my, mz = x - cx, y - cy, z - cz
                        length = np.sqrt(mx * mx + my * my + mz * mz)
                        mx, my, mz = mx / length, my / length, mz / length
                    gradients[j, i, 0], gradients[j, i, 1], gradients[j, i, 2] = mx, my, mz
                    image[j, i, 0], image[j, i, 1], image[j, i, 2] = x, y, z
                    distances[j, i], ordered[j * count + i] = distance, distance
                    total += squared
            rms = np.sqrt(total / (width * count))
            rank = min(int(quantile * width * count), width * count - 1)
            typical = max(spread * _select(ordered, rank), final_scale)
            if trust_rms:
                typical = max(typical, rms)
            if spread <= 0.0:  # whatever the distances are, smaller ones come to decide step by step
                typical = np.inf
            scale = max(min(scale * shrink, typical), final_scale)
            matrix[:] = 0.0
            twist[:] = 0.0
            for j in range(width):
                _accumulate(samples, image[j], gradients[j], distances[j], linear[j], scale, row, matrix, twist)
            last = block + 1 if together == 0 else directions.shape[0]
            advance(directions, points, block, last, matrix, twist, damping, largest_turn, largest_shift)
            moved = 0.0
            for a in range(6):
                moved = max(moved, abs(twist[a]))
            if moved <= step_tolerance + roughly * rms:
                break


@jit
def _select(values: FloatArray, rank: int) -> float:
    """The value with so many smaller ones before it, were they sorted; they are rearranged."""
    low, high = 0, values.shape[0] - 1
    while low < high:
        pivot = values[(low + high) // 2]
        left, right = low, high
        while left <= right:
            while values[left] < pivot:
                left += 1
            while pivot < values[right]:
                right -= 1
            if left <= right:
                values[left], values[right] = values[right], values[left]
                left, right = left + 1, right - 1
        if rank <= right:
            high = right
        elif rank >= left:
            low = left
        else:
            break
    return float(values[rank])


@jit
def advance(
    directions: FloatArray,
    points: FloatArray,
    first: int,
    last: int,
    matrix: FloatArray,
    twist: FloatArray,
    damping: float,
    largest_turn: float,
    largest_shift: float,
) -> None:
    """Move elements ``first`` up to ``last`` by the solution of the normal equations, which is left in ``twist``.

    Damping keeps motions out that leave the elements as they are (along a plane or an axis): these have no gradient.
    """
    trace = 0.0
    for a in range(6):
        trace += matrix[a, a]
    for a in range(6):
        matrix[a, a] += damping * trace + 1e-12
    _solve(matrix, twist)
    _clip(twist, 0, largest_turn)
    _clip(twist, 3, largest_shift)
    for k in range(first, last):
        _move(directions, points, k, twist)


@jit
def _accumulate(
    samples: FloatArray,
    image: FloatArray,
    gradients: FloatArray,
    distances: FloatArray,
    linear: FloatArray,
    scale: float,
    row: FloatArray,
    matrix: FloatArray,
    twist: FloatArray,
) -> None:
    """Add the weighted normal equations of one operation to ``matrix`` ``(6, 6)`` and the right side ``twist``.

    The unknowns are the turn (3) and the shift (3) of the element; ``row`` ``(6,)`` is scratch.
    """
    for i in range(samples.shape[0]):
        mx, my, mz = gradients[i, 0], gradients[i, 1], gradients[i, 2]
        # R^T m
        bx = linear[0, 0] * mx + linear[1, 0] * my + linear[2, 0] * mz
        by = linear[0, 1] * mx + linear[1, 1] * my + linear[2, 1] * mz
        bz = linear[0, 2] * mx + linear[1, 2] * my + linear[2, 2] * mz
        x, y, z = image[i, 0], image[i, 1], image[i, 2]
        qx, qy, qz = samples[i, 0], samples[i, 1], samples[i, 2]
        row[0] = (y * mz - z * my) - (qy * bz - qz * by)
        row[1] = (z * mx - x * mz) - (qz * bx - qx * bz)
        row[2] = (x * my - y * mx) - (qx * by - qy * bx)
        row[3], row[4], row[5] = mx - bx, my - by, mz - bz
        ratio = distances[i] / scale
        weight = 1.0 / ((1.0 + ratio * ratio) * (1.0 + ratio * ratio))
        pull = weight * distances[i]
        for a in range(6):
            weighted = weight * row[a]
            twist[a] -= pull * row[a]
            for b in range(a + 1):
                matrix[a, b] += weighted * row[b]


@jit
def _solve(matrix: FloatArray, vector: FloatArray) -> None:
    """Cholesky: overwrite ``vector`` with the solution; ``matrix`` (6, 6), lower triangle, is destroyed."""
    for a in range(6):
        for b in range(a + 1):
            total = matrix[a, b]
            for c in range(b):
                total -= matrix[a, c] * matrix[b, c]
            matrix[a, b] = np.sqrt(max(total, 1e-300)) if a == b else total / matrix[b, b]
    for a in range(6):
        total = vector[a]
        for c in range(a):
            total -= matrix[a, c] * vector[c]
        vector[a] = total / matrix[a, a]
    for a in range(5, -1, -1):
        total = vector[a]
        for c in range(a + 1, 6):
            total -= matrix[c, a] * vector[c]
        vector[a] = total / matrix[a, a]


@jit
def _clip(vector: FloatArray, first: int, largest: float) -> None:
    length = np.sqrt(vector[first] ** 2 + vector[first + 1] ** 2 + vector[first + 2] ** 2)
    if length > largest:
        for a in range(first, first + 3):
            vector[a] *= largest / length


@jit
def _move(directions: FloatArray, points: FloatArray, k: int, twist: FloatArray) -> None:
    """Turn element ``k`` about the origin by the first half of ``twist``, then shift it by the second."""
    wx, wy, wz = twist[0], twist[1], twist[2]
    angle = np.sqrt(wx * wx + wy * wy + wz * wz)
    if angle > 0.0:
        wx, wy, wz = wx / angle, wy / angle, wz / angle
        c, s = np.cos(angle), np.sin(angle)
        for vectors in (directions, points):
            x, y, z = vectors[k, 0], vectors[k, 1], vectors[k, 2]
            dot = (wx * x + wy * y + wz * z) * (1.0 - c)
            vectors[k, 0] = c * x + s * (wy * z - wz * y) + dot * wx
            vectors[k, 1] = c * y + s * (wz * x - wx * z) + dot * wy
            vectors[k, 2] = c * z + s * (wx * y - wy * x) + dot * wz
        length = np.sqrt(directions[k, 0] ** 2 + directions[k, 1] ** 2 + directions[k, 2] ** 2)
        for a in range(3):
            directions[k, a] /= length
    for a in range(3):
        points[k, a] += twist[3 + a]
