"""Bodies that lie inside others: not to be seen from outside, and surface all the same."""

import numpy as np

from model._jit import jit, kernel_array
from model.geometry.topology import connect_places, duplicate_vertex_map
from model.types import AnyArray, BoolArray, FloatArray, IntArray

_MOST_BODIES = 500
"""Of a file of more bodies, such as leaves or screws, it is not asked which lie in which."""

_MOST_ANGLES = 4_000_000
"""Solid angles of faces that are added up in search of bodies inside others; beyond, the rest count as outside."""

_INSIDE = 0.75
"""Winding number from which on a point is inside: 1 within a closed surface, half on it, less behind an open one."""


def inner_faces(vertices: FloatArray, faces: IntArray, merged: IntArray | None = None) -> tuple[BoolArray, int]:
    """Faces of bodies that lie wholly inside another body, ``(f,)``, and how many such bodies there are.

    A body is what hangs together by vertices at one place. Outer surfaces need not be watertight, but must surround
    what is in them from all sides; bodies that touch or cross the outer surface are not inside.

    Args:
        vertices: ``(v, 3)`` float64, any frame.
        faces: ``(f, 3)`` int32.
        merged: ``(v,)`` vertices at one place (`duplicate_vertex_map`), if that is known.
    """
    vertices, faces = kernel_array(vertices, np.float64), kernel_array(faces, np.int32)
    inside = np.zeros(len(faces), dtype=np.bool_)
    merged = kernel_array(duplicate_vertex_map(vertices) if merged is None else merged, np.int32)
    parts, used = np.empty(len(vertices), dtype=np.int32), np.zeros(len(vertices), dtype=np.bool_)
    connect_places(faces, merged, parts, used)
    numbers, boxes = np.full(len(vertices), -1, dtype=np.int32), np.empty((_MOST_BODIES, 6))
    count = _bound(vertices, parts, used, numbers, boxes)
    low, high = boxes[:count, :3], boxes[:count, 3:]
    around = np.asarray(((low < low[:, None]) & (high > high[:, None])).all(axis=2))
    if not around.any():
        return inside, 0
    of_face = numbers[parts[merged[faces[:, 0]]]]
    order = np.argsort(of_face, kind="stable")
    starts = np.searchsorted(of_face[order], np.arange(count + 1))
    left, found = _MOST_ANGLES, np.zeros(count, dtype=np.bool_)
    for inner in np.flatnonzero(around.any(axis=1)).tolist():
        points = _extremes(vertices, faces[order[starts[inner] : starts[inner + 1]]])
        for outer in np.flatnonzero(around[inner]).tolist():
            shell = faces[order[starts[outer] : starts[outer + 1]]]
            left -= len(points) * len(shell)
            if left < 0:
                break
            if _surrounds(vertices, shell, points, _INSIDE):
                found[inner] = True
                break
    inside[:] = found[of_face]
    return inside, int(found.sum())


def surrounds(vertices: FloatArray, shell: IntArray, inner: IntArray) -> bool:
    """Whether the faces ``shell`` ``(f, 3)`` go around those of another body ``(g, 3)`` from all sides."""
    return _surrounds(vertices, kernel_array(shell, np.int32), _extremes(vertices, inner), _INSIDE)


def _extremes(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Of a body's vertices the lowest along x, y and z, then the highest: (6, 3)."""
    used = vertices[faces.reshape(-1)]
    return np.concatenate([used[used.argmin(axis=0)], used[used.argmax(axis=0)]])


@jit
def _winding(vertices: FloatArray, faces: IntArray, point: AnyArray) -> float:
    """How often a surface goes around a point (van Oosterom and Strackee, "The Solid Angle of a Plane Triangle")."""
    total = 0.0
    for face in range(faces.shape[0]):
        i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, ay, az = vertices[i, 0] - point[0], vertices[i, 1] - point[1], vertices[i, 2] - point[2]
        bx, by, bz = vertices[j, 0] - point[0], vertices[j, 1] - point[1], vertices[j, 2] - point[2]
        cx, cy, cz = vertices[k, 0] - point[0], vertices[k, 1] - point[1], vertices[k, 2] - point[2]
        a = np.sqrt(ax * ax + ay * ay + az * az)
        b = np.sqrt(bx * bx + by * by + bz * bz)
        c = np.sqrt(cx * cx + cy * cy + cz * cz)
        volume = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
        below = a * b * c + (ax * bx + ay * by + az * bz) * c
        below += (bx * cx + by * cy + bz * cz) * a + (cx * ax + cy * ay + cz * az) * b
        total += 2.0 * np.arctan2(volume, below)
    return total / (4.0 * np.pi)


@jit
def _surrounds(vertices: FloatArray, faces: IntArray, points: FloatArray, least: float) -> bool:
    """Whether a surface goes around all points ``(p, 3)`` at least so often."""
    fewest = np.inf
    for row in range(points.shape[0]):
        if fewest > least:
            fewest = min(fewest, abs(_winding(vertices, faces, points[row])))
    return fewest > least


@jit
def _bound(vertices: FloatArray, parts: IntArray, used: BoolArray, numbers: IntArray, boxes: FloatArray) -> int:
    """Fill ``boxes`` with those of bodies; how many there are, 0 for too many.

    ``parts`` ``(v,)``: what hangs together has the same; ``used`` ``(v,)``: the vertices that count. ``numbers``
    ``(v,)``, all -1, are filled with the number of the body at the place that each part is named after.
    """
    count = 0
    for vertex in range(vertices.shape[0]):
        if not used[vertex]:
            continue
        part = parts[vertex]
        if numbers[part] < 0:
            if count == boxes.shape[0]:
                return 0
            numbers[part] = count
            for axis in range(3):
                boxes[count, axis], boxes[count, 3 + axis] = np.inf, -np.inf
            count += 1
        body = numbers[part]
        for axis in range(3):
            boxes[body, axis] = min(boxes[body, axis], vertices[vertex, axis])
            boxes[body, 3 + axis] = max(boxes[body, 3 + axis], vertices[vertex, axis])
    return count
