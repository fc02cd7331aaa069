"""Podolak et al. 2006 with a Gaussian Euclidean distance transform (GEDT): the transform of a function of space.

As `prst`, but of the function exp(-(distance / falloff)^2) on 64^3 voxels instead of the surface: pairs are drawn of
points as likely as the function is large, which is the product f(x) f(g x) that the transform integrates. What lies a
little off its mirror image still votes for the plane.
"""

import numpy as np

from model.types import FloatArray, IntArray
from training.baselines._volume import gaussian_volume
from training.baselines.prst import POINTS, maxima_of_votes

TITLE = "PRST with GEDT"

RESOLUTION = 64
FALLOFF = float(np.sqrt(8.0))
"""Voxels, as `training.baselines.kazhdan` has it."""

CLOSEST = 0.1
"""As in `prst`, but through a solid there are pairs at all distances."""

_MARGIN = 1.2


def find_planes(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> FloatArray:
    """`training.baselines.Baseline`."""
    volume = gaussian_volume(vertices, faces, RESOLUTION, _MARGIN * 0.5, FALLOFF)
    cumulative = np.cumsum(volume.values.ravel(), dtype=np.float64)
    drawn = np.searchsorted(cumulative, rng.random(POINTS) * cumulative[-1], side="right")
    points = volume.centres()[np.minimum(drawn, cumulative.size - 1)]
    points += (rng.random(points.shape) - 0.5) * volume.voxel
    return maxima_of_votes(points, vertices, faces, rng, CLOSEST)
