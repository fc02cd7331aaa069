"""What the network proposes for a shape: one forward pass or several, planes and rotations in the unit frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
import torch

from model.checkpoint import Checkpoint
from model.frames import inertia_frame
from model.network import axis_angle
from model.transforms import sign_free_mean
from model.types import BoolArray, FloatArray, IntArray
from model.voxels import voxelize

_SIGNS = np.array(sorted(product((1.0, -1.0), repeat=3), key=lambda signs: signs.count(-1.0)))
"""The frame as it comes, then mirrored along one axis, along two, along all. Averaged over all eight, the plane of a
head across a coordinate axis is exact where the shape is symmetric to it: its inputs come in pairs of equals, mirrored
along that axis and not. Of fewer frames some would have no partner."""

_SAME_DIRECTION = float(np.cos(np.pi / 4))


@dataclass(frozen=True, slots=True)
class Proposals:
    """Raw network output in the unit frame.

    ``planes`` ``(p, 4)`` rows ``(n, d)``, ``directions`` ``(r, 3)`` unit, ``angles`` ``(r,)`` radians.
    """

    planes: FloatArray
    directions: FloatArray
    angles: FloatArray


def input_rotation(checkpoint: Checkpoint, vertices: FloatArray, faces: IntArray) -> FloatArray:
    """The rotation ``(3, 3)`` from the unit frame to the frame the network is fed with first."""
    if checkpoint.input.frame == "unit":
        return np.eye(3)
    return inertia_frame(vertices, faces)[0]


def turned_voxels(checkpoint: Checkpoint, vertices: FloatArray, faces: IntArray, rotation: FloatArray) -> BoolArray:
    """The turned shape as the network is to see it: ``(R, R, R)``."""
    turned = np.ascontiguousarray(vertices @ rotation.T)
    return voxelize(turned, faces, checkpoint.network.architecture.resolution)


def predict(checkpoint: Checkpoint, grids: Sequence[BoolArray], rotations: Sequence[FloatArray]) -> list[Proposals]:
    """One pass, one batch: what the heads say of each view, in the unit frame.

    Args:
        checkpoint: the network.
        grids: the views' voxels ``(R, R, R)``. The first is averaged over sign frames if the weights ask for it; the
            others are taken as they come.
        rotations: from the unit frame to that of each view's voxels.
    """
    averaged = checkpoint.input.sign_frames
    planes, quaternions = _heads(checkpoint, grids, [averaged] + [1] * (len(grids) - 1))
    if averaged > 1:
        planes = np.concatenate([_mean_planes(planes[:, :averaged])[:, None], planes[:, averaged:]], axis=1)
        mean = sign_free_mean(quaternions[:, :averaged])
        quaternions = np.concatenate([mean[:, None], quaternions[:, averaged:]], axis=1)
    return _proposals(planes, quaternions, rotations)


def predict_each(checkpoint: Checkpoint, voxels: BoolArray, rotation: FloatArray, frames: int) -> Proposals:
    """One batch of ``frames`` sign choices (at most 8), every head of each a proposal of its own, in the unit frame."""
    planes, quaternions = _heads(checkpoint, [voxels], [frames])
    return _proposals(planes.reshape(-1, 1, 4), quaternions.reshape(-1, 1, 4), [rotation])[0]


def _heads(checkpoint: Checkpoint, grids: Sequence[BoolArray], frames: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Planes and quaternions ``(heads, all frames, 4)``, those of a view in the frame of its voxels."""
    chosen = [_SIGNS[:count] for count in frames]
    outputs = checkpoint.compiled(*((grid, signs < 0) for grid, signs in zip(grids, chosen, strict=True)))
    planes, quaternions = (output.double().numpy().transpose(1, 0, 2).copy() for output in outputs)
    signs = np.concatenate(chosen)
    planes[..., :3] *= signs
    # A mirrored copy turns the other way round: the axis is a pseudovector.
    quaternions[..., 1:] *= signs * signs.prod(1, keepdims=True)
    return planes, quaternions


def _proposals(planes: FloatArray, quaternions: FloatArray, rotations: Sequence[FloatArray]) -> list[Proposals]:
    """Of each view ``(heads, views, 4)``, out of the frame of its voxels back into the unit frame."""
    directions, angles = (values.numpy() for values in axis_angle(torch.as_tensor(quaternions)))
    return [
        Proposals(
            np.column_stack([planes[:, view, :3] @ rotation, planes[:, view, 3]]),
            directions[:, view] @ rotation,
            angles[:, view],
        )
        for view, rotation in enumerate(rotations)
    ]


def next_rotation(proposals: Proposals, rotation: FloatArray) -> FloatArray:
    """The frame of the predicted normals, made orthonormal: where the next pass looks from.

    Heads that nearly coincide span no frame; then the one before stays.
    """
    normals = proposals.planes[:, :3]
    if len(normals) < 3 or abs(np.linalg.det(normals)) < 0.2:
        return rotation
    left, _, right = np.linalg.svd(normals)
    turned = left @ right
    if np.linalg.det(turned) < 0:
        turned[2] *= -1.0
    return turned


def _mean_planes(planes: FloatArray) -> FloatArray:
    """Mean of each head's planes ``(h, k, 4)`` over sign frames: ``(h, 4)``.

    Outliers (a head that switched planes) are left out.
    """
    normals = planes[..., :3]
    agree = np.abs(normals @ normals[:, 0, :, None])[..., 0] > _SAME_DIRECTION
    mean = sign_free_mean(normals * agree[..., None])
    signs = np.sign(normals @ mean[..., None])[..., 0] * agree
    offsets = (signs * planes[..., 3]).sum(1) / agree.sum(1)
    return np.column_stack([mean, offsets])
