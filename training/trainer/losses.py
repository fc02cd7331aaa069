"""The paper's two losses (section 4)."""

from dataclasses import dataclass

import torch
from torch import Tensor

PAPER_SAMPLES = 1000
"""The loss is a sum over this many samples (section 6.1); with fewer it is scaled up to it, so that weights keep."""


def reflections(planes: Tensor) -> tuple[Tensor, Tensor]:
    """Reflections in planes (Eq. 1) as affine maps ``x -> linear x + shift``.

    ``(b, h, 4)`` rows ``(n, d)`` with ``|n| = 1`` give ``(b, h, 3, 3)`` and ``(b, h, 3)``.
    """
    normal, offset = planes[..., :3], planes[..., 3:]
    linear = torch.eye(3, device=planes.device) - 2.0 * normal[..., :, None] * normal[..., None, :]
    return linear, -2.0 * offset * normal


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
    """One batch's loss and its parts; ``plane_errors`` and ``rotation_errors`` ``(b, h)`` are means over samples."""

    total: Tensor
    symmetry: Tensor
    regularization: Tensor
    plane_errors: Tensor
    rotation_errors: Tensor


def combine(distances: Tensor, planes: Tensor, quaternions: Tensor, weight: float, best_head: float) -> Losses:
    """The overall loss ``L_sd + w_r L_r`` (Eqs. 4 and 8), summed over samples and heads, averaged over the batch.

    Args:
        distances: ``(b, n, heads)``: (squared) distance of every transformed sample, planes first.
        planes: ``(b, p, 4)``.
        quaternions: ``(b, r, 4)``.
        weight: w_r.
        best_head: weight of three times the smallest plane error; 0 in the paper.
    """
    means = distances.mean(1)
    sums = PAPER_SAMPLES * means
    count = planes.shape[1]
    symmetry = sums.sum(1).mean()
    penalty = regularization(planes, quaternions).mean()
    total = symmetry + weight * penalty
    if best_head > 0:
        total = total + best_head * 3.0 * sums[:, :count].amin(1).mean()
    errors = means.detach()
    return Losses(total, symmetry.detach(), penalty.detach(), errors[:, :count], errors[:, count:])
