"""What the network proposes for a shape: one forward pass or several, planes and rotations in the unit frame."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from model.geometry.integrals import inertia_rotation
from model.geometry.transforms import axis_angle, sign_free_mean, turned
from model.geometry.voxels import voxelize
from model.network.checkpoint import Checkpoint
from model.types import BoolArray, FloatArray, IntArray

_SIGNS = np.array(sorted(product((1.0, -1.0), repeat=3), key=lambda signs: signs.count(-1.0)))
"""The frame as it comes, then mirrored along one axis, along two, along all. Where the shape is symmetric to an axis of
its frame, the mean of a head over two frames mirrored along it is a plane exactly across that axis or along it: the
network was fed with the same twice."""

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
    return inertia_rotation(vertices, faces)


def rotated_voxels(checkpoint: Checkpoint, vertices: FloatArray, faces: IntArray, rotation: FloatArray) -> BoolArray:
    """The turned shape as the network is to see it: ``(R, R, R)``."""
    return voxelize(turned(vertices, rotation), faces, checkpoint.architecture.resolution)


def predict(checkpoint: Checkpoint, grids: Sequence[BoolArray], rotations: Sequence[FloatArray]) -> list[Proposals]:
    """One pass, one batch: what the heads say of each view, in the unit frame.

    Where the weights ask for several sign frames that is what each head says in every frame, the mean of every two and
    the mean of all.

    Args:
        checkpoint: the network.
        grids: the views' voxels ``(R, R, R)``.
        rotations: from the unit frame to that of each view's voxels.
    """
    frames = checkpoint.input.sign_frames
    seen = _heads(checkpoint, grids, _SIGNS[:frames])
    planes, quaternions = (values.reshape(len(values), len(grids), frames, 4) for values in seen)
    if frames > 1:
        planes, quaternions = _with_means(planes, _mean_planes), _with_means(quaternions, sign_free_mean)
    return _proposals(planes, quaternions, rotations)


def predict_each(checkpoint: Checkpoint, voxels: BoolArray, rotation: FloatArray, frames: slice) -> Proposals:
    """One batch of some of the 8 sign choices, every head of each a proposal of its own, in the unit frame."""
    planes, quaternions = (values[:, None] for values in _heads(checkpoint, [voxels], _SIGNS[frames]))
    return _proposals(planes, quaternions, [rotation])[0]


def _heads(checkpoint: Checkpoint, grids: Sequence[BoolArray], signs: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Planes and quaternions ``(heads, views x frames, 4)``, those of a view in the frame of its voxels.

    ``signs`` ``(frames, 3)``: of the axes of each frame of a view.
    """
    outputs = checkpoint.compiled(*((grid, signs < 0) for grid in grids))
    planes, quaternions = (output.astype(np.float64).transpose(1, 0, 2).copy() for output in outputs)
    # Unit to seven digits as they come; their matrices are to be orthogonal to the last.
    planes /= np.linalg.norm(planes[..., :3], axis=-1, keepdims=True)
    quaternions /= np.linalg.norm(quaternions, axis=-1, keepdims=True)
    signs = np.tile(signs, (len(grids), 1))
    planes[..., :3] *= signs
    # A mirrored copy turns the other way round: the axis is a pseudovector.
    quaternions[..., 1:] *= signs * signs.prod(1, keepdims=True)
    return planes, quaternions


def _with_means(values: FloatArray, mean: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Values ``(h, v, k, 4)`` of k frames, then the means of every two and, of more, of all: ``(h, v, more, 4)``."""
    frames = values.shape[2]
    pairs = np.array(list(combinations(range(frames), 2)))
    parts = [values, mean(values[:, :, pairs])]
    if frames > 2:
        parts.append(mean(values)[:, :, None])
    return np.concatenate(parts, axis=2)


def _proposals(planes: FloatArray, quaternions: FloatArray, rotations: Sequence[FloatArray]) -> list[Proposals]:
    """Answers ``(h, v, k, 4)`` of every view, out of the frame of its voxels back into the unit frame."""
    directions, angles = axis_angle(quaternions)
    return [
        Proposals(
            np.concatenate([planes[:, view, :, :3] @ rotation, planes[:, view, :, 3:]], axis=-1).reshape(-1, 4),
            (directions[:, view] @ rotation).reshape(-1, 3),
            angles[:, view].ravel(),
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
    """Mean of a head's planes ``(..., k, 4)`` over sign frames: ``(..., 4)``.

    Outliers (a head that switched planes) are left out.
    """
    normals = planes[..., :3]
    agree = np.abs((normals * normals[..., :1, :]).sum(-1)) > _SAME_DIRECTION
    mean = sign_free_mean(normals * agree[..., None])
    signs = np.sign((normals * mean[..., None, :]).sum(-1)) * agree
    offsets = (signs * planes[..., 3]).sum(-1) / agree.sum(-1)
    return np.concatenate([mean, offsets[..., None]], axis=-1)
