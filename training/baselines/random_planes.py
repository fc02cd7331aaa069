"""Planes through the centroid in random directions: what refinement alone is worth, with nothing to start from."""

import numpy as np

from model.types import FloatArray, IntArray

TITLE = "random planes"
COUNT = 72


def find_planes(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> FloatArray:
    """`training.baselines.Baseline`; `COUNT` planes in no order."""
    normals = rng.normal(size=(COUNT, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.column_stack([normals, np.zeros(COUNT)])
