"""Oriented bounding box (paper, section 6.2; Chang, Gorissen and Melchior 2011): the mid-planes of the least box.

Chang searches the box of least volume by a genetic algorithm over rotations. trimesh finds it by enumeration: one side
of its box lies on a face of the convex hull, which for nearly all shapes is the box of least volume, too.
"""

import numpy as np
from trimesh.bounds import oriented_bounds

from model.geometry.frames import inertia_frame
from model.types import FloatArray, IntArray

TITLE = "oriented bounding box"
_FLAT = 1e-10


def find_planes(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> FloatArray:
    """`training.baselines.Baseline`. A flat shape has no hull and gets the box along its principal axes."""
    points = vertices[np.unique(faces)]
    principal, values = inertia_frame(vertices, faces)
    if values[2] > _FLAT * values[0]:
        return np.ascontiguousarray(oriented_bounds(points)[0][:3])
    turned = points @ principal.T
    return np.column_stack([principal, -(turned.max(0) + turned.min(0)) / 2.0])
