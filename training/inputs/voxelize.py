"""Exact surface voxelization of a batch of meshes in torch: the same voxels as `model.geometry.voxels.voxelize`.

The serving kernel is compiled for the CPU; training on a GPU needs its result there, thousands of times a second.
Both decide by the same separating-axis test of a closed triangle against a closed box (Akenine-Moeller), so a
network sees in service what it saw in training. A test holds the two against each other.
"""

import torch
from torch import Tensor

from training.inputs.meshbatch import MeshBatch

PAIRS_AT_ONCE = 4_000_000
"""Triangle-voxel pairs tested together; bounds the memory."""

TOUCH = 1e-6
"""Slack in voxels: single precision must not lose a voxel that is only touched."""


def voxelize_batch(batch: MeshBatch, resolution: int) -> Tensor:
    """Occupied voxels of each shape.

    Args:
        batch: triangles in the frame of the grid, the cube ``[-0.5, 0.5]^3``; what lies outside is ignored.
        resolution: R, voxels along an edge.

    Returns:
        ``(b, R, R, R)`` bool, indices in the order x, y, z.
    """
    corners = (batch.corners + 0.5) * resolution
    low = (corners.amin(1) - TOUCH).floor().clamp(0, resolution).long()
    high = (corners.amax(1) + TOUCH).floor().clamp(-1, resolution - 1).long()
    extent = (high - low + 1).clamp_min(0)
    pairs = extent.prod(1)
    occupied = torch.zeros((batch.size, resolution**3), dtype=torch.bool, device=corners.device)
    ends = pairs.cumsum(0)
    total = int(ends[-1]) if len(ends) else 0
    for first in range(0, total, PAIRS_AT_ONCE):
        pair = torch.arange(first, min(first + PAIRS_AT_ONCE, total), device=corners.device)
        triangle = torch.searchsorted(ends, pair, right=True)
        within = pair - (ends - pairs)[triangle]
        size = extent[triangle]
        z = within % size[:, 2]
        y = within // size[:, 2] % size[:, 1]
        x = within // (size[:, 2] * size[:, 1])
        voxel = low[triangle] + torch.stack([x, y, z], dim=1)
        hit = _overlaps(corners[triangle] - (voxel[:, None] + 0.5))
        flat = (voxel[:, 0] * resolution + voxel[:, 1]) * resolution + voxel[:, 2]
        occupied[batch.shape[triangle[hit]], flat[hit]] = True
    return occupied.view(batch.size, resolution, resolution, resolution)


def _overlaps(corners: Tensor) -> Tensor:
    """Does the triangle ``(p, 3, 3)`` meet the box ``[-0.5, 0.5]^3``? The box's own axes are already decided."""
    half = 0.5 + TOUCH
    a, b, c = corners.unbind(1)
    hit = torch.ones(len(corners), dtype=torch.bool, device=corners.device)
    for edge, start, opposite in ((b - a, a, c), (c - b, b, a), (a - c, c, b)):
        # Cross products of the edge with the three box axes; two corners project to the same value.
        for first, second in ((1, 2), (2, 0), (0, 1)):
            on_edge = edge[:, first] * start[:, second] - edge[:, second] * start[:, first]
            apart = edge[:, first] * opposite[:, second] - edge[:, second] * opposite[:, first]
            radius = half * (edge[:, first].abs() + edge[:, second].abs())
            hit &= (torch.minimum(on_edge, apart) <= radius) & (torch.maximum(on_edge, apart) >= -radius)
    normal = torch.linalg.cross(b - a, c - a)
    hit &= (normal * a).sum(-1).abs() <= half * normal.abs().sum(-1)
    return hit
