"""The loops behind `model.search.closure`, and places that hang together for `model.search.exactness`."""

import numpy as np

from model._jit import jit, jit_allocating
from model.types import AnyArray, FloatArray, IntArray


@jit_allocating
def close(generators: FloatArray, least_trace: float, group: FloatArray) -> int:
    """Fill ``group`` ``(m, 3, 3)`` with all products of the generators ``(k, 3, 3)``, the identity first.

    Matrices A and B are the same if the trace of A^T B is above ``least_trace``.

    Returns:
        how many there are; -1 if they are more than there is room for.
    """
    product = np.empty((3, 3))
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
