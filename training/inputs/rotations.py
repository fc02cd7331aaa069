"""Rotations as batches of tensors: from quaternions, from rotation vectors, at random."""

import torch
from torch import Tensor


def rotation_matrices(quaternions: Tensor) -> Tensor:
    """Rotations by unit quaternions ``(..., 4)`` (Eq. 2) as matrices ``(..., 3, 3)``."""
    w, x, y, z = quaternions.unbind(-1)
    rows = [
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ]  # fmt: skip
    return torch.stack(rows, dim=-1).unflatten(-1, (3, 3))


def uniform_rotations(count: int, generator: torch.Generator, device: torch.device) -> Tensor:
    """Rotations uniform on SO(3), ``(count, 3, 3)``: normalised Gaussian quaternions."""
    quaternions = torch.randn((count, 4), generator=generator, device=device)
    return rotation_matrices(quaternions / quaternions.norm(dim=1, keepdim=True))


def rotation_vectors(vectors: Tensor) -> Tensor:
    """Rotations about ``vectors`` ``(b, 3)`` by their length in radians, as matrices."""
    angle = vectors.norm(dim=1, keepdim=True).clamp_min(1e-12)
    return rotation_matrices(torch.cat([torch.cos(angle / 2), torch.sin(angle / 2) * vectors / angle], dim=1))
