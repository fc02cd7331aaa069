"""The paper's two losses (section 4)."""

from dataclasses import dataclass

import torch
from torch import Tensor


def reflect(points: Tensor, planes: Tensor) -> Tensor:
    """Reflect points in planes (Eq. 1): ``(b, n, 3)`` in ``(b, h, 4)`` rows ``(n, d)``, ``|n| = 1``: ``(b, h, n, 3)``."""
    normal, offset = planes[..., :3], planes[..., 3:]
    height = torch.einsum("bnc,bhc->bhn", points, normal) + offset
    return points[:, None] - 2.0 * height[..., None] * normal[:, :, None]


def rotate(points: Tensor, quaternions: Tensor) -> Tensor:
    """Rotate points about axes through the origin (Eq. 2): ``(b, n, 3)`` by unit ``(b, h, 4)``: ``(b, h, n, 3)``."""
    real, imaginary = quaternions[:, :, None, :1], quaternions[:, :, None, 1:]
    points = points[:, None].expand(-1, quaternions.shape[1], -1, -1)
    imaginary = imaginary.expand_as(points)
    twist = 2.0 * torch.linalg.cross(imaginary, points)
    return points + real * twist + torch.linalg.cross(imaginary, twist)


def regularization(planes: Tensor, quaternions: Tensor) -> Tensor:
    """``|A|_F^2 + |B|_F^2`` (Eqs. 5 to 7), per shape: ``(b,)``.

    B takes the imaginary part of the quaternion as it is, not the unit axis: at perpendicular axes it is zero for
    half turns and grows as the angle shrinks, which is what keeps rotations from collapsing to the identity
    (the authors' code does the same).
    """
    total = planes.new_zeros(len(planes))
    for rows in (planes[..., :3], quaternions[..., 1:]):
        gram = rows @ rows.mT - torch.eye(rows.shape[1], device=rows.device)
        total = total + gram.square().sum((1, 2))
    return total


@dataclass(slots=True)
class Losses:
    """One batch's loss and its parts; ``plane_errors`` ``(b, h)`` and ``rotation_errors`` are means over the samples."""

    total: Tensor
    symmetry: Tensor
    regularization: Tensor
    plane_errors: Tensor
    rotation_errors: Tensor


def combine(
    distances: Tensor, planes: Tensor, quaternions: Tensor, weight: float, best_head: float
) -> Losses:
    """The overall loss ``L_sd + w_r L_r`` (Eqs. 4 and 8), summed over samples and heads, averaged over the batch.

    Args:
        distances: ``(b, heads, n)``: (squared) distance of every transformed sample, planes first.
        planes: ``(b, p, 4)``.
        quaternions: ``(b, r, 4)``.
        weight: w_r.
        best_head: weight of three times the smallest plane error; 0 in the paper.
    """
    sums = distances.sum(-1)
    count, samples = planes.shape[1], distances.shape[-1]
    symmetry = sums.sum(1).mean()
    penalty = regularization(planes, quaternions).mean()
    total = symmetry + weight * penalty
    if best_head > 0:
        total = total + best_head * 3.0 * sums[:, :count].amin(1).mean()
    errors = sums.detach() / samples
    return Losses(total, symmetry.detach(), penalty.detach(), errors[:, :count], errors[:, count:])
