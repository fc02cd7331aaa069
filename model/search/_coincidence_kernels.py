"""Which vertices images of features coincide with, and how far they are from given faces at most.

Of what is symmetric as it was drawn, images of vertices lie on vertices: to know that takes one look at each, without
the tree. Everything is in the axes of the tree.
"""

from typing import Any

import numpy as np

from model._jit import jit, jit_allocating, jit_inlined
from model.geometry._operation_kernels import image_of
from model.types import BoolArray, FloatArray, IntArray

_CELL = 16.0
"""Edge of a cell, in distances that still coincide: most images are within one cell with all that is so near."""

_FARTHEST = 4.0
"""Coordinates beyond are of no surface in the unit frame."""

_COMPARED = 8
"""Pairs that may be compared, on average: where vertices crowd, the rest is left to the tree."""


@jit
def mark_places(first: IntArray, faces: IntArray, places: BoolArray) -> None:
    """Set ``places`` ``(v,)``, all false, where faces have corners: of vertices at one place the ``first``."""
    for face in range(faces.shape[0]):
        for k in range(3):
            places[first[faces[face, k]]] = True


@jit_allocating
def find_coinciding(
    points: FloatArray,
    fixed: FloatArray,
    linear: FloatArray,
    vertices: FloatArray,
    places: BoolArray,
    distance: float,
    found: IntArray,
    gaps: FloatArray,
) -> None:
    """Fill ``found`` ``(m,)`` with the vertex that the image ``R (p - f) + f`` of each point coincides with, or -1.

    The images are put into a table, and all vertices that count (``places`` ``(v,)``) are led past it. ``gaps``
    ``(m,)``: how far apart they are; at most ``distance``, or infinity.
    """
    count, size = len(points), 16
    while size < 4 * count:
        size *= 2
    heads, following = np.full(size, np.int32(-1), dtype=np.int32), np.empty(8 * count, dtype=np.int32)
    marks, mark_mask = np.zeros(size // 8, dtype=np.uint64), 8 * size - 1
    images = np.empty((count, 3))
    scale = 1.0 / (_CELL * distance)
    for i in range(count):
        found[i], gaps[i] = -1, np.inf
        image_of(points[i], fixed, linear, images[i])
        x, y, z = images[i, 0], images[i, 1], images[i, 2]
        if not max(abs(x), abs(y), abs(z)) < _FARTHEST:
            continue
        entry = 8 * i
        for a in range(_cell(x - distance, scale), _cell(x + distance, scale) + 1):
            for b in range(_cell(y - distance, scale), _cell(y + distance, scale) + 1):
                for c in range(_cell(z - distance, scale), _cell(z + distance, scale) + 1):
                    key = _key(a, b, c)
                    marks[(key & mark_mask) >> 6] |= np.uint64(1) << np.uint64(key & 63)
                    slot = (key >> 6) & (size - 1)
                    following[entry], heads[slot] = heads[slot], entry
                    entry += 1
    left = _COMPARED * (count + len(vertices))
    for vertex in range(len(vertices)):
        if not places[vertex]:
            continue
        x, y, z = vertices[vertex, 0], vertices[vertex, 1], vertices[vertex, 2]
        if not max(abs(x), abs(y), abs(z)) < _FARTHEST:
            continue
        key = _key(_cell(x, scale), _cell(y, scale), _cell(z, scale))
        if not (marks[(key & mark_mask) >> 6] >> np.uint64(key & 63)) & np.uint64(1):
            continue
        entry = heads[(key >> 6) & (size - 1)]
        while entry >= 0 and left > 0:
            left -= 1
            i = entry // 8
            entry = following[entry]
            dx, dy, dz = images[i, 0] - x, images[i, 1] - y, images[i, 2] - z
            gap = np.sqrt(dx * dx + dy * dy + dz * dz)
            if gap <= distance and gap < gaps[i]:
                gaps[i], found[i] = gap, vertex


@jit_inlined
def _cell(coordinate: float, scale: float) -> Any:
    return np.int64(np.floor(coordinate * scale))


@jit_inlined
def _key(x: Any, y: Any, z: Any) -> Any:
    """Of a cell: not negative, its lower bits as good as its higher ones."""
    key = np.uint64(x) * np.uint64(0x9E3779B97F4A7C15)
    key = (key ^ (key >> np.uint64(32)) ^ np.uint64(y)) * np.uint64(0xD6E8FEB86659FD93)
    key = (key ^ (key >> np.uint64(32)) ^ np.uint64(z)) * np.uint64(0xD6E8FEB86659FD93)
    return np.int64((key ^ (key >> np.uint64(32))) >> np.uint64(1))


@jit_allocating
def bound_distances(
    points: FloatArray,
    fixed: FloatArray,
    linear: FloatArray,
    candidates: IntArray,
    vertices: FloatArray,
    faces: IntArray,
    bounds: FloatArray,
) -> None:
    """Fill ``bounds`` ``(m,)`` with the distance of each image from one of its ``candidates`` ``(m, k)``.

    From the first that it lies above, or else from the nearest. Candidates are faces, -1 for none; infinity where there
    are none.
    """
    image = np.empty(3)
    for i in range(len(points)):
        image_of(points[i], fixed, linear, image)
        least, above, k = np.inf, False, 0
        while k < candidates.shape[1] and not above:
            face = candidates[i, k]
            k += 1
            if face >= 0:
                squared, above = _squared_distance(
                    image[0],
                    image[1],
                    image[2],
                    int(faces[face, 0]),
                    int(faces[face, 1]),
                    int(faces[face, 2]),
                    vertices,
                )
                least = min(least, squared)
        bounds[i] = np.sqrt(least)


@jit
def _squared_distance(x: float, y: float, z: float, i: int, j: int, k: int, vertices: FloatArray) -> tuple[float, bool]:
    """Of a point from a triangle of whatever shape, and whether the point lies above its inside."""
    ax, ay, az = x - vertices[i, 0], y - vertices[i, 1], z - vertices[i, 2]
    bx, by, bz = x - vertices[j, 0], y - vertices[j, 1], z - vertices[j, 2]
    cx, cy, cz = x - vertices[k, 0], y - vertices[k, 1], z - vertices[k, 2]
    ux, uy, uz = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
    vx, vy, vz = vertices[k, 0] - vertices[j, 0], vertices[k, 1] - vertices[j, 1], vertices[k, 2] - vertices[j, 2]
    wx, wy, wz = vertices[i, 0] - vertices[k, 0], vertices[i, 1] - vertices[k, 1], vertices[i, 2] - vertices[k, 2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    square = nx * nx + ny * ny + nz * nz
    if square > 0.0:
        left = (ny * uz - nz * uy) * ax + (nz * ux - nx * uz) * ay + (nx * uy - ny * ux) * az
        right = (ny * vz - nz * vy) * bx + (nz * vx - nx * vz) * by + (nx * vy - ny * vx) * bz
        back = (ny * wz - nz * wy) * cx + (nz * wx - nx * wz) * cy + (nx * wy - ny * wx) * cz
        if min(left, right, back) >= 0.0:
            height = nx * ax + ny * ay + nz * az
            return height * height / square, True
    first = _to_segment(ax, ay, az, ux, uy, uz)
    return min(first, _to_segment(bx, by, bz, vx, vy, vz), _to_segment(cx, cy, cz, wx, wy, wz)), False


@jit_inlined
def _to_segment(x: float, y: float, z: float, ex: float, ey: float, ez: float) -> float:
    """Squared distance of a point from the segment from the origin to ``e``."""
    length = ex * ex + ey * ey + ez * ez
    share = min(max((ex * x + ey * y + ez * z) / length, 0.0), 1.0) if length > 0.0 else 0.0
    x, y, z = x - share * ex, y - share * ey, z - share * ez
    return x * x + y * y + z * z
