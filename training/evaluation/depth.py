"""The part of a surface that depth images see: what a scanner has of an object that it looks at from a few sides."""

import numpy as np

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
        seen |= _seen(cloud, middle, direction, pixel)
    used, kept = np.unique(faces[seen], return_inverse=True)
    return vertices[used], np.ascontiguousarray(kept.reshape(-1, 3), dtype=np.int32)


def _seen(cloud: FloatArray, points: FloatArray, direction: FloatArray, pixel: float) -> BoolArray:
    """Which ``points`` no part of the ``cloud`` hides from a camera that looks along ``direction``."""
    across = np.linalg.svd(direction[None])[2][1:]
    origin = (cloud @ across.T).min(0)

    def place(at: FloatArray) -> tuple[np.ndarray, np.ndarray]:
        column, row = np.floor((at @ across.T - origin) / pixel).astype(np.int64).T
        return column, row

    depth = np.full((PIXELS + 2, PIXELS + 2), np.inf)
    np.minimum.at(depth, place(cloud), cloud @ direction)
    return points @ direction <= depth[place(points)] + _TOLERANCE * pixel
