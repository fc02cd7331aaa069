"""Samples and closest-point grids for sets prepared without them, or for another resolution."""

import torch
from torch import Tensor

from training.data.closest_grid import flood_closest
from training.inputs.meshbatch import MeshBatch, sample_surfaces

DERIVED_SAMPLES = 4096
_DENSE = 16384
"""Samples a derived grid is flooded from; only the first `DERIVED_SAMPLES` are kept."""


def derive(meshes: MeshBatch, grid: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Surface samples ``(b, DERIVED_SAMPLES, 3)`` and closest points ``(b, grid^3, 3)`` of a batch, its own frame."""
    points, _ = sample_surfaces(meshes, _DENSE, generator)
    return points[:, :DERIVED_SAMPLES], flood_closest(points, grid)
