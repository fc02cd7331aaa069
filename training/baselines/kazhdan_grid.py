"""Kazhdan et al. 2002 as published: the minima of the reflective symmetry distance on its grid of directions."""

import numpy as np

from model.types import FloatArray, IntArray
from training.baselines.kazhdan import symmetry_minima

TITLE = "Kazhdan 2002, grid minima"


def find_planes(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> FloatArray:
    """`training.baselines.Baseline`."""
    return symmetry_minima(vertices, faces, fit=False)
