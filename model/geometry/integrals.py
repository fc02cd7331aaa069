"""The frames of a surface, computed triangle by triangle in compiled code.

`model.geometry.frames` says the same in numpy, for training without a compiler, and makes copies of all corners on the
way. Here nothing is copied, and sums are taken in one order everywhere: over blocks of faces, then over the blocks,
so that a million of them lose no digits.
"""

import numpy as np

from model._jit import jit, kernel_array
from model.errors import DegenerateMeshError
from model.geometry.frames import UnitFrame
from model.types import AnyArray, FloatArray, IntArray

_BLOCK = 1024

_TIE = 1e-6
"""Moments of inertia that differ by less, as a share of the largest, are equal but for the rounding of a file."""

_ALONG = 0.9
"""Cosine above which a direction lies along a coordinate axis, across which no other can be told from it."""


def unit_frame(vertices: FloatArray, faces: IntArray) -> UnitFrame:
    """What `UnitFrame.of` says of a surface, ``(v, 3)`` float64 and ``(f, 3)`` int32.

    Raises:
        DegenerateMeshError: the surface has no area.
    """
    vertices, faces = kernel_array(vertices, np.float64), kernel_array(faces, np.int32)
    used, box = np.zeros(len(vertices), dtype=np.uint8), np.empty((2, 3))
    _bounds(vertices, faces, used, box)
    extent = float((box[1] - box[0]).max())
    if not extent > 0.0:
        raise DegenerateMeshError("The mesh has no extent: all its points coincide.")
    middle = (box[0] + box[1]) / 2.0
    scaled, sums = np.empty_like(vertices), np.zeros(4)
    _scale(vertices, middle, extent, scaled)  # first: squares of a mesh far from the origin, or tiny, would lose digits
    _centroid_sums(scaled, faces, sums)
    total = sums[3]
    if not total > 0.0:
        raise DegenerateMeshError("The surface has no area: every face is a line or a point.")
    centroid = sums[:3] / (3.0 * total)
    radius = float(np.sqrt(_largest_square(scaled, used, centroid)))
    return UnitFrame(middle + extent * centroid, 2.0 * radius * extent)


def principal_frame(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """The inertia frame of a surface with its signs settled by the shape, ``(3, 3)``, proper.

    Eigenvectors come with arbitrary signs. Along the first two axes the third moment of the face centres, weighted by
    area, is made positive, so that a shape in another pose is looked at from the same side. Where it vanishes the shape
    is mirror-symmetric enough for either side to do.
    """
    rotation = inertia_rotation(vertices, faces)
    sums = np.zeros(2)
    _skews(kernel_array(vertices, np.float64), kernel_array(faces, np.int32), rotation, sums)
    signs = np.where(sums < 0.0, -1.0, 1.0)
    return np.ascontiguousarray(np.append(signs, signs.prod())[:, None] * rotation)


def inertia_rotation(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """The rotation ``(3, 3)`` that `model.geometry.frames.inertia_frame` gives, its ties broken.

    Where eigenvalues tie, as they do for every shape with an axis of order 3 or more, any directions within their span
    are eigenvectors, and rounding would choose. Here they follow the coordinate axes.
    """
    sums = np.zeros(7)
    _second_moments(kernel_array(vertices, np.float64), kernel_array(faces, np.int32), sums)
    xx, yy, zz, xy, xz, yz = sums[:6] / (12.0 * sums[6])
    values, vectors = np.linalg.eigh(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]))
    rotation = np.ascontiguousarray(vectors.T[::-1])
    first, second = values[2] - values[1] < _TIE * values[2], values[1] - values[0] < _TIE * values[2]
    if first and second:
        return np.eye(3)
    if first or second:
        alone = rotation[2 if first else 0]
        across = np.eye(3)[0 if abs(alone[0]) < _ALONG else 1]
        across = across - (across @ alone) * alone
        across /= np.linalg.norm(across)
        other = np.cross(alone, across)
        rotation = np.array([across, other, alone] if first else [alone, across, other])
    if np.linalg.det(rotation) < 0:
        rotation[2] *= -1.0
    return rotation


def mean_normal(vertices: FloatArray, faces: IntArray) -> float:
    """Length of the mean of a surface's unit normals, weighted by area: 0 for a closed one, 1 for a flat one."""
    sums = np.zeros(4)
    _normal_sums(kernel_array(vertices, np.float64), kernel_array(faces, np.int32), sums)
    return float(np.linalg.norm(sums[:3]) / sums[3]) if sums[3] > 0.0 else 0.0


@jit
def _normal_sums(vertices: FloatArray, faces: IntArray, sums: FloatArray) -> None:
    """Add the normals of faces, as long as twice their areas, and these lengths."""
    count = faces.shape[0]
    for first in range(0, count, _BLOCK):
        sx, sy, sz, total = 0.0, 0.0, 0.0, 0.0
        for face in range(first, min(first + _BLOCK, count)):
            a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
            px, py, pz = (
                vertices[b, 0] - vertices[a, 0],
                vertices[b, 1] - vertices[a, 1],
                vertices[b, 2] - vertices[a, 2],
            )
            qx, qy, qz = (
                vertices[c, 0] - vertices[a, 0],
                vertices[c, 1] - vertices[a, 1],
                vertices[c, 2] - vertices[a, 2],
            )
            x, y, z = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
            sx += x
            sy += y
            sz += z
            total += np.sqrt(x * x + y * y + z * z)
        sums[0] += sx
        sums[1] += sy
        sums[2] += sz
        sums[3] += total


@jit
def _bounds(vertices: FloatArray, faces: IntArray, used: AnyArray, box: FloatArray) -> None:
    """Mark the vertices that faces use, and find the box around them."""
    for face in range(faces.shape[0]):
        used[faces[face, 0]] = 1
        used[faces[face, 1]] = 1
        used[faces[face, 2]] = 1
    for axis in range(3):
        low, high = np.inf, -np.inf
        for vertex in range(vertices.shape[0]):
            if used[vertex]:
                low, high = min(low, vertices[vertex, axis]), max(high, vertices[vertex, axis])
        box[0, axis], box[1, axis] = low, high


@jit
def _area(ax: float, ay: float, az: float, bx: float, by: float, bz: float, cx: float, cy: float, cz: float) -> float:
    """Of a triangle."""
    px, py, pz = bx - ax, by - ay, bz - az
    qx, qy, qz = cx - ax, cy - ay, cz - az
    x, y, z = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
    return 0.5 * np.sqrt(x * x + y * y + z * z)


@jit
def _scale(vertices: FloatArray, middle: FloatArray, extent: float, scaled: FloatArray) -> None:
    """Fill ``scaled`` ``(v, 3)`` with the places of vertices about ``middle`` in units of ``extent``."""
    for vertex in range(vertices.shape[0]):
        for axis in range(3):
            scaled[vertex, axis] = (vertices[vertex, axis] - middle[axis]) / extent


@jit
def _centroid_sums(vertices: FloatArray, faces: IntArray, sums: FloatArray) -> None:
    """Add area times the sum of the corners, and the area."""
    count = faces.shape[0]
    for first in range(0, count, _BLOCK):
        sx, sy, sz, total = 0.0, 0.0, 0.0, 0.0
        for face in range(first, min(first + _BLOCK, count)):
            a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
            ax, ay, az = vertices[a, 0], vertices[a, 1], vertices[a, 2]
            bx, by, bz = vertices[b, 0], vertices[b, 1], vertices[b, 2]
            cx, cy, cz = vertices[c, 0], vertices[c, 1], vertices[c, 2]
            area = _area(ax, ay, az, bx, by, bz, cx, cy, cz)
            sx += (ax + bx + cx) * area
            sy += (ay + by + cy) * area
            sz += (az + bz + cz) * area
            total += area
        sums[0] += sx
        sums[1] += sy
        sums[2] += sz
        sums[3] += total


@jit
def _largest_square(vertices: FloatArray, used: AnyArray, centroid: FloatArray) -> float:
    """Of the distances of used vertices from ``centroid``."""
    largest = 0.0
    for vertex in range(vertices.shape[0]):
        if used[vertex]:
            x = vertices[vertex, 0] - centroid[0]
            y = vertices[vertex, 1] - centroid[1]
            z = vertices[vertex, 2] - centroid[2]
            largest = max(largest, x * x + y * y + z * z)
    return largest


@jit
def _second_moments(vertices: FloatArray, faces: IntArray, sums: FloatArray) -> None:
    """Add area times the sum over the corners and their sum of xx, yy, zz, xy, xz, yz, and the area."""
    count = faces.shape[0]
    for first in range(0, count, _BLOCK):
        xx, yy, zz, xy, xz, yz, total = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for face in range(first, min(first + _BLOCK, count)):
            a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
            ax, ay, az = vertices[a, 0], vertices[a, 1], vertices[a, 2]
            bx, by, bz = vertices[b, 0], vertices[b, 1], vertices[b, 2]
            cx, cy, cz = vertices[c, 0], vertices[c, 1], vertices[c, 2]
            area = _area(ax, ay, az, bx, by, bz, cx, cy, cz)
            sx, sy, sz = ax + bx + cx, ay + by + cy, az + bz + cz
            xx += area * (ax * ax + bx * bx + cx * cx + sx * sx)
            yy += area * (ay * ay + by * by + cy * cy + sy * sy)
            zz += area * (az * az + bz * bz + cz * cz + sz * sz)
            xy += area * (ax * ay + bx * by + cx * cy + sx * sy)
            xz += area * (ax * az + bx * bz + cx * cz + sx * sz)
            yz += area * (ay * az + by * bz + cy * cz + sy * sz)
            total += area
        sums[0] += xx
        sums[1] += yy
        sums[2] += zz
        sums[3] += xy
        sums[4] += xz
        sums[5] += yz
        sums[6] += total


@jit
def _skews(vertices: FloatArray, faces: IntArray, rotation: FloatArray, sums: AnyArray) -> None:
    """Add area times the cube of three times the centre's place along the first two rows of ``rotation``."""
    count = faces.shape[0]
    for first in range(0, count, _BLOCK):
        along, across = 0.0, 0.0
        for face in range(first, min(first + _BLOCK, count)):
            a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
            ax, ay, az = vertices[a, 0], vertices[a, 1], vertices[a, 2]
            bx, by, bz = vertices[b, 0], vertices[b, 1], vertices[b, 2]
            cx, cy, cz = vertices[c, 0], vertices[c, 1], vertices[c, 2]
            area = _area(ax, ay, az, bx, by, bz, cx, cy, cz)
            sx, sy, sz = ax + bx + cx, ay + by + cy, az + bz + cz
            u = rotation[0, 0] * sx + rotation[0, 1] * sy + rotation[0, 2] * sz
            v = rotation[1, 0] * sx + rotation[1, 1] * sy + rotation[1, 2] * sz
            along += u * u * u * area
            across += v * v * v * area
        sums[0] += along
        sums[1] += across
