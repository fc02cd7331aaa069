"""The part of a surface that depth images see: what a scanner has of an object that it looks at from a few sides."""

import numpy as np

from model._jit import jit, kernel_array
from model.geometry.sampling import sample_surface
from model.meshes.subdivision import subdivide
from model.types import BoolArray, FloatArray, IntArray

PIXELS = 96
"""Edge of a depth image; the shape fills it."""

_LONGEST_EDGE = 1.5
"""Longer edges, in pixels, are halved: a triangle is then seen or hidden as a whole."""

_TOLERANCE = 2.0
"""A triangle is seen whose centroid lies no deeper than this many pixels behind what its pixel and those around it
show: a surface that rises by more than 60 degrees is lost at the rim, as in a scan."""

_SAMPLES_PER_PIXEL = 8


def visible_part(vertices: FloatArray, faces: IntArray, directions: FloatArray) -> tuple[FloatArray, IntArray]:
    """The triangles that are seen from one of the ``directions`` ``(k, 3)``, orthographically.

    Both sides of a triangle can be seen. Returns vertices ``(v, 3)`` and faces ``(f, 3)``; long edges are halved first.
    """
    corners = vertices[faces].reshape(-1, 3)
    pixel = float(np.linalg.norm(corners.max(0) - corners.min(0))) / PIXELS
    vertices, faces = subdivide(vertices, faces, _LONGEST_EDGE * pixel)
    middle = vertices[faces].mean(1)
    cloud, _ = sample_surface(vertices, faces, _SAMPLES_PER_PIXEL * PIXELS * PIXELS, seed=0)
    cloud = np.concatenate([cloud, middle])
    seen = np.zeros(len(faces), dtype=np.bool_)
    for direction in directions:
        seen |= seen_from(cloud, middle, direction, pixel)
    used, kept = np.unique(faces[seen], return_inverse=True)
    return vertices[used], np.ascontiguousarray(kept.reshape(-1, 3), dtype=np.int32)


def seen_from(cloud: FloatArray, points: FloatArray, direction: FloatArray, pixel: float) -> BoolArray:
    """Which ``points`` ``(m, 3)`` no part of the ``cloud`` ``(n, 3)`` hides from a camera looking along ``direction``.

    The points are a part of the cloud. All in one frame and unit; ``pixel`` is the edge of a pixel, the whole cloud has
    to fit into `PIXELS` of them.
    """
    axes = np.concatenate([np.linalg.svd(direction[None])[2][1:], direction[None]])
    depth = np.full((PIXELS + 2, PIXELS + 2), np.inf)
    seen = np.zeros(len(points), dtype=np.bool_)
    cloud, points, axes = (kernel_array(part, np.float64) for part in (cloud, points, axes))
    _look(cloud, points, axes, pixel, _TOLERANCE * pixel, depth, seen)
    return seen


@jit
def _look(
    cloud: FloatArray,
    points: FloatArray,
    axes: FloatArray,
    pixel: float,
    tolerance: float,
    depth: FloatArray,
    seen: BoolArray,
) -> None:
    """Fill the depth image and mark what it shows; ``axes``: across, across, along."""
    left = low = np.inf
    for i in range(cloud.shape[0]):
        x, y, z = cloud[i, 0], cloud[i, 1], cloud[i, 2]
        left = min(left, x * axes[0, 0] + y * axes[0, 1] + z * axes[0, 2])
        low = min(low, x * axes[1, 0] + y * axes[1, 1] + z * axes[1, 2])
    for i in range(cloud.shape[0]):
        x, y, z = cloud[i, 0], cloud[i, 1], cloud[i, 2]
        column = int((x * axes[0, 0] + y * axes[0, 1] + z * axes[0, 2] - left) / pixel)
        row = int((x * axes[1, 0] + y * axes[1, 1] + z * axes[1, 2] - low) / pixel)
        depth[column, row] = min(depth[column, row], x * axes[2, 0] + y * axes[2, 1] + z * axes[2, 2])
    for i in range(points.shape[0]):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        column = int((x * axes[0, 0] + y * axes[0, 1] + z * axes[0, 2] - left) / pixel)
        row = int((x * axes[1, 0] + y * axes[1, 1] + z * axes[1, 2] - low) / pixel)
        seen[i] = x * axes[2, 0] + y * axes[2, 1] + z * axes[2, 2] <= depth[column, row] + tolerance
