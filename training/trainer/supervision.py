"""Supervision by the planes of a classical method (paper, section 6, "Network Pre-training"). Torch and numpy alone.

The paper starts its network on the planes of Kazhdan's method. Here `training label` writes the planes of a method of
choice beside a prepared set, and a recipe's section ``[supervision]`` adds a loss that draws the heads to them: for
the first steps (pre-training), or all along.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from training.data.prepared import PreparedSet
from training.inputs.inputs import Pose
from training.recipe import SupervisionRecipe

_SOFT = 1e-3
"""Where the plain distance becomes a square: at a twentieth of a degree."""


@dataclass(slots=True)
class Targets:
    """What is known of a batch of shapes, in the canonical (unit) frame.

    ``planes`` ``(b, k, 4)`` rows ``(n, d)``, of which ``known`` ``(b, k)`` bool marks those that are meant.
    ``direction`` and ``point`` ``(b, 3)`` of a continuous axis, every plane through which is a symmetry; the direction
    is zero where a shape has none.
    """

    planes: Tensor
    known: Tensor
    direction: Tensor
    point: Tensor


class PlaneLabels:
    """The labels of a prepared set on the training device, by shape index."""

    def __init__(self, prepared: PreparedSet, device: torch.device, max_error: float) -> None:
        """Load the planes whose error is at most ``max_error``.

        Raises:
            ValueError: the set has no labels.
        """
        if prepared.labels is None:
            raise ValueError(f"{prepared.root}, or a set mixed into it, has no labels; run `training label` first")
        parts = prepared.arrays("planes")
        rows = np.full((len(prepared), max(part.shape[1] for part in parts), 5), np.inf, dtype=np.float32)
        for part, end in zip(parts, np.cumsum([len(part) for part in parts]).tolist(), strict=True):
            rows[end - len(part) : end, : part.shape[1]] = part
        labels = torch.from_numpy(rows).to(device)
        self._known = labels[..., 4] <= max_error
        self._planes = labels[..., :4].masked_fill(~self._known[..., None], 0.0)
        axes = torch.from_numpy(np.concatenate(prepared.arrays("families"))).to(device)
        self._direction, self._point = axes[:, :3], axes[:, 3:]

    def of(self, shapes: Tensor) -> Targets:
        """The labels of ``shapes`` ``(b,)``."""
        return Targets(self._planes[shapes], self._known[shapes], self._direction[shapes], self._point[shapes])


def canonical_planes(planes: Tensor, pose: Pose) -> Tensor:
    """Planes ``(b, p, 4)`` of the fed frame in the canonical frame; normals stay of unit length."""
    normals = planes[..., :3] @ pose.rotation
    shift = (normals * pose.center[:, None]).sum(-1)
    return torch.cat([normals, (planes[..., 3] * pose.scale[:, None] - shift)[..., None]], dim=-1)


def supervision(planes: Tensor, targets: Targets, heads: float, plain: bool = False) -> Tensor:
    """How far predicted planes ``(b, p, 4)`` are from the known ones, both in the canonical frame: ``(b,)``.

    The distance of two planes is the ground-truth error, ``min |(n, d) -+ (n', d')|^2``, or with ``plain`` its root:
    about the angle between them, which goes on pulling where the square has all but vanished. Every known plane counts
    with its nearest head, of at most as many known planes as there are heads, those with the nearest ones: a cube must
    not pull three heads nine ways. ``heads`` times the mean distance of every head to its nearest known plane comes on
    top. Planes through a continuous axis are one target, wherever a head stands: its nearest one. A shape of which
    nothing is known counts zero.
    """
    rows = targets.planes[:, None].expand(-1, planes.shape[1], -1, -1)
    nearest = _through_axis(planes.detach(), targets.direction, targets.point)
    rows = torch.cat([rows, nearest[:, :, None]], dim=2)
    known = torch.cat([targets.known, (targets.direction != 0).any(1, keepdim=True)], dim=1)
    if plain:
        # The sum of squared differences, not 2 - 2 |inner|: close to zero that is rounding alone.
        sign = torch.where((rows * planes[:, :, None]).sum(-1, keepdim=True) < 0, -1.0, 1.0)
        distances = ((sign * rows - planes[:, :, None]).square().sum(-1) + _SOFT**2).sqrt()
    else:
        inner = (rows * planes[:, :, None]).sum(-1).abs()
        distances = rows.square().sum(-1) + planes.square().sum(-1)[:, :, None] - 2.0 * inner
    distances = distances.masked_fill(~known[:, None], torch.inf)
    count = known.sum(1)
    asked = distances.amin(1).sort(1).values[:, : planes.shape[1]]
    asked = asked.masked_fill(asked.isinf(), 0.0).sum(1) / count.clamp(1, planes.shape[1])
    answered = distances.amin(2)
    answered = answered.masked_fill(answered.isinf(), 0.0).mean(1)
    return asked + heads * answered


def supervised(labels: PlaneLabels, shapes: Tensor, planes: Tensor, pose: Pose, recipe: SupervisionRecipe) -> Tensor:
    """The supervised loss of a batch, before its weight: `supervision`, averaged over the shapes."""
    return supervision(canonical_planes(planes, pose), labels.of(shapes), recipe.heads, recipe.plain).mean()


def _through_axis(planes: Tensor, direction: Tensor, point: Tensor) -> Tensor:
    """The plane through each shape's axis nearest in direction to each of ``planes`` ``(b, p, 4)``: ``(b, p, 4)``."""
    along = (planes[..., :3] * direction[:, None]).sum(-1, keepdim=True)
    normals = planes[..., :3] - along * direction[:, None]
    normals = normals / normals.norm(dim=-1, keepdim=True).clamp_min(1e-6)
    return torch.cat([normals, -(normals * point[:, None]).sum(-1, keepdim=True)], dim=-1)
