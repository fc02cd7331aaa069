"""The proposals of several frames (views) of a shape, and of all of them those that fit its voxels best.

Where two moments of inertia nearly tie, noise or a hole turns the inertia frame by any angle, and all its sign frames
with it: the heads then agree on something wrong. Turned by 45 degrees about the first or the last axis, which mixes the
axes that tie, the shape looks different enough to be answered anew. And the answers to mirrored copies of a damaged
shape differ by a degree or so, of which one is nearest. Which to trust is decided on the voxels the network was fed
with, not on the mesh: no exact distance is taken before validation (section 5 of the paper).

The planes and half turns of the main frame itself, where all heads start from before they are trained, stand for
election too: where the shape is whole they are exact, and a network trained on damaged ones moves some of them.
"""

from collections.abc import Sequence

import numpy as np

from model.geometry.operations import Operations
from model.geometry.scan import DistanceGrid
from model.geometry.transforms import rotation_matrix
from model.network.checkpoint import Checkpoint
from model.network.proposals import Proposals, predict
from model.types import BoolArray, FloatArray

_EIGHTH = np.pi / 4
_TURNS = (rotation_matrix(np.array([1.0, 0.0, 0.0]), _EIGHTH), rotation_matrix(np.array([0.0, 0.0, 1.0]), _EIGHTH))
VIEWS = 1 + len(_TURNS)

_POINTS = 512
"""Occupied voxels that are moved; twice as many would decide the same within the noise."""

_PLANES_APART = float(np.cos(np.deg2rad(30.0)))
"""Of two planes closer than the dihedral angle of the paper's validation the worse says nothing new."""

_AXES_APART = float(np.cos(np.deg2rad(60.0)))
"""A surface of revolution has a two-fold axis in every direction across its own: three of them could displace it."""


def other_views(rotation: FloatArray) -> list[FloatArray]:
    """The further frames ``(3, 3)`` beside that of ``rotation``."""
    return [turn @ rotation for turn in _TURNS]


def look(checkpoint: Checkpoint, grids: Sequence[BoolArray], rotations: Sequence[FloatArray]) -> Proposals:
    """One pass over all views: what the network says of the shape, chosen where it says several things.

    Args:
        checkpoint: the network.
        grids: the views' voxels ``(R, R, R)``, the main view's first.
        rotations: from the unit frame to that of each view's voxels.
    """
    candidates = predict(checkpoint, grids, rotations)
    if len(grids) == checkpoint.input.sign_frames == 1:
        return candidates[0]
    heads = checkpoint.architecture
    return select_proposals(candidates, grids[0], rotations[0], heads.planes, heads.rotations)


def select_proposals(
    candidates: Sequence[Proposals], voxels: BoolArray, rotation: FloatArray, planes: int, rotations: int
) -> Proposals:
    """Of all candidates, those of the frame itself among them, the ones that map the voxels onto themselves best.

    Args:
        candidates: planes and rotations in the unit frame, any number.
        voxels: ``(R, R, R)`` to judge by.
        rotation: ``(3, 3)`` from the unit frame to that of the voxels.
        planes: how many planes to select_proposals at most.
        rotations: how many rotations.

    Returns:
        the best first, planes 30 degrees apart and axes 60.
    """
    frame = Proposals(np.column_stack([rotation, np.zeros(3)]), rotation, np.full(3, np.pi))
    everything = [frame, *candidates]
    mirrors = np.concatenate([one.planes for one in everything])
    directions = np.concatenate([one.directions for one in everything])
    angles = np.concatenate([one.angles for one in everything])
    grid = DistanceGrid(voxels, _POINTS)
    # In the frame of the grid.
    normals, axes = mirrors[:, :3] @ rotation.T, directions @ rotation.T
    reflections = Operations.reflections(np.column_stack([normals, mirrors[:, 3]]))
    turns = Operations.rotations(axes, np.zeros(3), angles)
    interpolated_error = grid.interpolated_error(Operations.joined([reflections, turns]))
    best = _best(normals, interpolated_error[: len(mirrors)], planes, _PLANES_APART)
    turned = _best(axes, interpolated_error[len(mirrors) :], rotations, _AXES_APART)
    return Proposals(mirrors[best], directions[turned], angles[turned])


def _best(directions: FloatArray, interpolated_error: FloatArray, count: int, apart: float) -> list[int]:
    """At most ``count`` rows of the lowest interpolated_error, their directions' cosines not over ``apart``."""
    left = interpolated_error.copy()
    kept: list[int] = []
    while len(kept) < count and np.isfinite(left).any():
        best = int(left.argmin())
        kept.append(best)
        left[np.abs(directions @ directions[best]) > apart] = np.inf
    return kept
