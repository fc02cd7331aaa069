"""The orientation in which a tree of boxes fits a surface best.

A box along the coordinate axes fits long thin triangles badly when they run across the axes: a part with many of them,
turned by 45 degrees, takes up to a hundred times longer to search. Man-made parts mostly have three directions of their
own, and the tree may be built in those.
"""

import numpy as np

from model._jit import jit
from model.types import FloatArray, IntArray

_SAMPLE = 256  # faces by which an orientation is judged
_CANDIDATES = 8
_WORTHWHILE = 0.7  # share of the boxes' surface that must remain at most, or the axes stay as they are


def tree_axes(vertices: FloatArray, faces: IntArray) -> FloatArray | None:
    """(3, 3) rotation, new axes as rows, that makes the boxes around triangles much smaller; None if there is none."""
    step = -(-len(faces) // _SAMPLE)
    best, axes = _surface(vertices, faces, step, np.eye(3)) * _WORTHWHILE, None
    segment = step * max(_SAMPLE // _CANDIDATES, 1)
    candidate = np.empty((3, 3))
    for start in range(0, len(faces), segment):
        _frame_of_worst(vertices, faces, start, min(start + segment, len(faces)), step, candidate)
        surface = _surface(vertices, faces, step, candidate)
        if surface < best:
            best, axes = surface, candidate.copy()
    return axes


@jit
def _surface(vertices: FloatArray, faces: IntArray, step: int, axes: FloatArray) -> float:
    """Half the surface of the boxes around every step-th triangle, seen in the given axes."""
    total = 0.0
    for face in range(0, faces.shape[0], step):
        x = _extent(vertices, faces, face, axes, 0)
        y = _extent(vertices, faces, face, axes, 1)
        z = _extent(vertices, faces, face, axes, 2)
        total += x * y + y * z + z * x
    return total


@jit
def _extent(vertices: FloatArray, faces: IntArray, face: int, axes: FloatArray, axis: int) -> float:
    i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
    x, y, z = axes[axis, 0], axes[axis, 1], axes[axis, 2]
    a = vertices[i, 0] * x + vertices[i, 1] * y + vertices[i, 2] * z
    b = vertices[j, 0] * x + vertices[j, 1] * y + vertices[j, 2] * z
    c = vertices[k, 0] * x + vertices[k, 1] * y + vertices[k, 2] * z
    return max(a, b, c) - min(a, b, c)


@jit
def _frame_of_worst(vertices: FloatArray, faces: IntArray, start: int, end: int, step: int, axes: FloatArray) -> None:
    """Axes along an edge and the normal of the triangle that wastes most of its box, among some of the faces."""
    worst, largest = start, -1.0
    for face in range(start, end, step):
        i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
        px, py, pz = (
            vertices[j, 0] - vertices[i, 0],
            vertices[j, 1] - vertices[i, 1],
            vertices[j, 2] - vertices[i, 2],
        )
        qx, qy, qz = (
            vertices[k, 0] - vertices[i, 0],
            vertices[k, 1] - vertices[i, 1],
            vertices[k, 2] - vertices[i, 2],
        )
        x = max(px, qx, 0.0) - min(px, qx, 0.0)
        y = max(py, qy, 0.0) - min(py, qy, 0.0)
        z = max(pz, qz, 0.0) - min(pz, qz, 0.0)
        nx, ny, nz = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
        waste = x * y + y * z + z * x - np.sqrt(nx * nx + ny * ny + nz * nz)
        if waste > largest:
            worst, largest = face, waste
    # The edge of middle length: of a rectangle's half it is a side, and of a needle it has the needle's direction.
    first, second = -1.0, -1.0
    longest, middle = 0, 0
    for edge in range(3):
        length = 0.0
        for axis in range(3):
            a, b = faces[worst, edge], faces[worst, (edge + 1) % 3]
            length += (vertices[b, axis] - vertices[a, axis]) ** 2
        if length > first:
            first, second = length, first
            longest, middle = edge, longest
        elif length > second:
            second, middle = length, edge
    for row, edge in ((0, middle), (1, longest)):
        a, b = faces[worst, edge], faces[worst, (edge + 1) % 3]
        for axis in range(3):
            axes[row, axis] = vertices[b, axis] - vertices[a, axis]
    _orthonormalise(axes)


@jit
def _orthonormalise(axes: FloatArray) -> None:
    """Turn the first two rows into a right-handed frame; identity where they span no plane."""
    x, y, z = axes[0, 0], axes[0, 1], axes[0, 2]
    length = np.sqrt(x * x + y * y + z * z)
    valid = length > 1e-150
    if valid:
        x, y, z = x / length, y / length, z / length
        dot = x * axes[1, 0] + y * axes[1, 1] + z * axes[1, 2]
        u, v, w = axes[1, 0] - dot * x, axes[1, 1] - dot * y, axes[1, 2] - dot * z
        if u * u + v * v + w * w <= 1e-24 * dot * dot:  # a needle without width: any perpendicular
            u, v, w = (0.0, -z, y) if abs(x) < 0.6 else (z, 0.0, -x)
        length = np.sqrt(u * u + v * v + w * w)
        u, v, w = u / length, v / length, w / length
        dot = x * u + y * v + z * w
        u, v, w = u - dot * x, v - dot * y, w - dot * z
        length = np.sqrt(u * u + v * v + w * w)
        axes[0, 0], axes[0, 1], axes[0, 2] = x, y, z
        axes[1, 0], axes[1, 1], axes[1, 2] = u / length, v / length, w / length
        axes[2, 0] = y * axes[1, 2] - z * axes[1, 1]
        axes[2, 1] = z * axes[1, 0] - x * axes[1, 2]
        axes[2, 2] = x * axes[1, 1] - y * axes[1, 0]
    else:
        for row in range(3):
            for axis in range(3):
                axes[row, axis] = 1.0 if row == axis else 0.0
