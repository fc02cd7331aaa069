"""The loops behind `model.search.closure`, and places that hang together for `model.search.exactness`."""

import numpy as np

from model._jit import jit, jit_allocating
from model.types import AnyArray, FloatArray, IntArray


@jit_allocating
def close(generators: FloatArray, same: float, snapped: int, group: FloatArray) -> int:
    """Fill ``group`` ``(m, 3, 3)`` with all products of the generators ``(k, 3, 3)``, the identity first.

    Matrices are one within ``same`` radians. Angles of products as near to those of orders up to ``snapped`` are made
    so: of planes 44 degrees apart the fourth power of the rotation that they make would not be the identity.

    Returns:
        how many there are; -1 if they are more than there is room for.
    """
    product, axis, least_trace = np.empty((3, 3)), np.empty(3), 1.0 + 2.0 * np.cos(same)
    for a in range(3):
        for b in range(3):
            group[0, a, b] = 1.0 if a == b else 0.0
    count, done = 1, 0
    while done < count:
        known = count
        for g in range(generators.shape[0]):
            for member in range(done, known):
                for a in range(3):
                    for b in range(3):
                        product[a, b] = 0.0
                        for c in range(3):
                            product[a, b] += generators[g, a, c] * group[member, c, b]
                if _is_known(product, group, count, least_trace):
                    continue
                if count == group.shape[0]:
                    return -1
                _orthogonal(product, group[count])
                if snapped > 0:
                    _snap(group[count], same, snapped, axis)
                count += 1
        done = known
    return count


@jit
def _is_known(matrix: FloatArray, group: FloatArray, count: int, least_trace: float) -> bool:
    for k in range(count):
        trace = 0.0
        for a in range(3):
            for b in range(3):
                trace += matrix[a, b] * group[k, a, b]
        if trace > least_trace:
            return True
    return False


@jit
def _orthogonal(matrix: FloatArray, result: FloatArray) -> None:
    """A step towards the nearest orthogonal matrix: products drift by rounding, which this squares."""
    for a in range(3):
        for b in range(3):
            result[a, b] = 1.5 * matrix[a, b]
            for c in range(3):
                square = 0.0
                for d in range(3):
                    square += matrix[a, d] * matrix[c, d]
                result[a, b] -= 0.5 * square * matrix[c, b]


@jit
def _snap(matrix: FloatArray, same: float, largest: int, axis: FloatArray) -> None:
    """Turn a member, proper or not, to the nearest angle of an order up to ``largest``, if it is within ``same``."""
    for a in range(3):  # twice the sine of the angle along the axis
        b, c = (a + 1) % 3, (a + 2) % 3
        axis[a] = matrix[c, b] - matrix[b, c]
    determinant = 0.0
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        determinant += matrix[0, a] * (matrix[1, b] * matrix[2, c] - matrix[1, c] * matrix[2, b])
    sign = 1.0 if determinant > 0.0 else -1.0
    twice = np.sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2])
    if twice < 1e-9:
        return  # the identity, a half turn, a reflection or an inversion: exact by being so
    angle = np.arctan2(twice, sign * (matrix[0, 0] + matrix[1, 1] + matrix[2, 2]) - 1.0)
    target, gap = angle, same
    for order in range(2, largest + 1):
        place = 2.0 * np.pi / order * np.rint(angle * order / (2.0 * np.pi))
        if abs(place - angle) < gap - 1e-12:
            target, gap = place, abs(place - angle)
    cosine, sine = np.cos(target), np.sin(target)
    for a in range(3):
        axis[a] *= sign / twice
    for a in range(3):
        for b in range(3):
            matrix[a, b] = (1.0 - cosine) * axis[a] * axis[b] + (cosine if a == b else 0.0)
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        matrix[c, b] += sine * axis[a]
        matrix[b, c] -= sine * axis[a]
    for a in range(3):
        for b in range(3):
            matrix[a, b] *= sign


@jit_allocating
def connected(cells: AnyArray, grid: IntArray, labels: IntArray) -> None:
    """Label the occupied ``cells`` ``(n, 3)`` of a grid: those that touch, at a corner too, get the same number.

    ``grid`` ``(x, y, z)`` is scratch that holds all cells with a margin of one. ``labels`` ``(n,)`` count from 0, in
    the order of the first cell of each.
    """
    x, y, z = grid.shape
    flat = grid.ravel()
    flat[:] = 0
    for i in range(len(cells)):
        flat[(cells[i, 0] * y + cells[i, 1]) * z + cells[i, 2]] = -1
    stack = np.empty(len(cells), dtype=np.int64)
    found = 0
    for start in range(x * y * z):
        if flat[start] != -1:
            continue
        found += 1
        flat[start], stack[0], top = found, start, 1
        while top > 0:
            top -= 1
            here = stack[top]
            for i in range(-1, 2):
                for j in range(-1, 2):
                    for k in range(-1, 2):
                        other = here + (i * y + j) * z + k
                        if flat[other] == -1:
                            flat[other] = found
                            stack[top] = other
                            top += 1
    for i in range(len(cells)):
        labels[i] = flat[(cells[i, 0] * y + cells[i, 1]) * z + cells[i, 2]] - 1
