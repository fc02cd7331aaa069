"""Closest-point grids on the training device, for prepared sets that come without one (section 4.1, after Eq. 3).

`training prepare` writes exact grids. Where a set was packed to travel, or a recipe asks for another resolution,
they are derived here from surface samples by jump flooding: every voxel passes its nearest known sample on
to its neighbours in strides of R/2, R/4, ..., 1, then once more in a stride of 1.
"""

from itertools import product

import torch
from torch import Tensor

_STEPS = (-1, 0, 1)
_NEIGHBOURS = [(x, y, z) for x, y, z in product(_STEPS, _STEPS, _STEPS) if (x, y, z) != (0, 0, 0)]


def voxel_centres(resolution: int, device: torch.device) -> Tensor:
    """Centres of the voxels of the unit cube: ``(R^3, 3)``, order x, y, z."""
    ticks = (torch.arange(resolution, device=device) + 0.5) / resolution - 0.5
    return torch.stack(torch.meshgrid(ticks, ticks, ticks, indexing="ij"), dim=-1).reshape(-1, 3)


def flood_closest(points: Tensor, resolution: int) -> Tensor:
    """Nearly the nearest sample to the centre of every voxel; one sample a voxel takes part, the rest are left out.

    Args:
        points: ``(b, n, 3)`` float, surface samples in the unit frame.
        resolution: R.

    Returns:
        ``(b, R^3, 3)``: the sample found for each voxel.
    """
    size, count = points.shape[:2]
    centres = voxel_centres(resolution, points.device)
    cell = ((points + 0.5) * resolution).long().clamp(0, resolution - 1)
    flat = (cell[..., 0] * resolution + cell[..., 1]) * resolution + cell[..., 2]
    # Of the samples that share a voxel, the one nearest to its centre is the seed.
    reach = (points - centres[flat]).square().sum(-1)
    least = torch.full((size, resolution**3), torch.inf, device=points.device).scatter_reduce(1, flat, reach, "amin")
    winner = reach == least.gather(1, flat)
    nearest = torch.full((size, resolution**3), -1, dtype=torch.long, device=points.device)
    rank = torch.where(winner, torch.arange(count, device=points.device), -1)
    nearest = nearest.scatter_reduce(1, flat, rank, "amax")
    distance = _distances(points, nearest, centres)
    strides = [2**k for k in reversed(range(resolution.bit_length() - 1))]
    for stride in [*strides, 1]:
        grid = nearest.view(size, resolution, resolution, resolution)
        for offset in _NEIGHBOURS:
            candidate = _shifted(grid, offset, stride).reshape(size, -1)
            reach = _distances(points, candidate, centres)
            closer = reach < distance
            distance = torch.where(closer, reach, distance)
            nearest = torch.where(closer, candidate, nearest)
    return torch.gather(points, 1, nearest.clamp_min(0)[..., None].expand(-1, -1, 3))


def _shifted(grid: Tensor, offset: tuple[int, int, int], stride: int) -> Tensor:
    """What the neighbour at ``offset * stride`` knows; -1 outside the grid."""
    resolution = grid.shape[1]
    shifted = torch.full_like(grid, -1)
    target, source = [slice(None)], [slice(None)]
    for step in offset:
        move = step * stride
        target.append(slice(max(0, -move), resolution - max(0, move)))
        source.append(slice(max(0, move), resolution - max(0, -move)))
    shifted[tuple(target)] = grid[tuple(source)]
    return shifted


def _distances(points: Tensor, index: Tensor, centres: Tensor) -> Tensor:
    """Squared distances from each centre to its indexed sample, infinite where the index is -1."""
    found = torch.gather(points, 1, index.clamp_min(0)[..., None].expand(-1, -1, 3))
    return (found - centres).square().sum(-1).masked_fill(index < 0, torch.inf)
