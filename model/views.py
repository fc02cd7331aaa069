"""A shape looked at from more than one frame, and the planes and rotations chosen that fit what the network sees.

Where two moments of inertia nearly tie, noise or a hole turns the inertia frame by any angle, and all its sign frames
with it: the heads then agree on something wrong. Turned by 45 degrees about the first or the last axis, which mixes the
axes that tie, the shape looks different enough to be answered anew. Which answer to trust is decided on the voxels the
network was fed with, not on the mesh: no exact distance is taken before validation (section 5 of the paper).

The planes and half turns of the main frame itself, which are where all heads start from before they are trained, stand
for election too: where the shape is whole they are exact, and a network trained on damaged ones moves some of them.
"""

from collections.abc import Sequence

import numpy as np

from model.operations import Operations
from model.proposals import Proposals
from model.scan import DistanceGrid
from model.transforms import rotation_matrix
from model.types import BoolArray, FloatArray

_EIGHTH = np.pi / 4
_TURNS = (rotation_matrix(np.array([1.0, 0.0, 0.0]), _EIGHTH), rotation_matrix(np.array([0.0, 0.0, 1.0]), _EIGHTH))
VIEWS = 1 + len(_TURNS)

_POINTS = 512
"""Occupied voxels that are reflected; all of them would decide the same within the noise."""

_TRUST = 0.75
"""Scores of the main view count so much: it is averaged over sign frames, the others are not (settled on held-out
training shapes, docs/decisions/0007-further-views.md)."""

_APART = float(np.cos(np.pi / 6))
"""Of two planes closer than the dihedral angle of the paper's validation the worse says nothing new."""


def other_views(rotation: FloatArray) -> list[FloatArray]:
    """The further frames ``(3, 3)`` beside that of ``rotation``."""
    return [turn @ rotation for turn in _TURNS]


def choose(views: Sequence[Proposals], voxels: BoolArray, rotation: FloatArray) -> Proposals:
    """What maps the voxels onto themselves best of all that the views and the main frame say, at most one a head.

    Args:
        views: planes and rotations in the unit frame, the main view's first.
        voxels: ``(R, R, R)`` as the main view is fed with.
        rotation: ``(3, 3)`` from the unit frame to that of the voxels.
    """
    heads, turning = len(views[0].planes), len(views[0].directions)
    own = np.column_stack([rotation, np.zeros(3)])
    said = [*views, Proposals(own, rotation[:turning], np.full(turning, np.pi))]
    planes = np.concatenate([view.planes for view in said])
    directions = np.concatenate([view.directions for view in said])
    angles = np.concatenate([view.angles for view in said])
    grid = DistanceGrid(voxels, _POINTS)
    # In the frame of the grid.
    normals, axes = planes[:, :3] @ rotation.T, directions @ rotation.T
    mirrors = Operations.reflections(np.column_stack([normals, planes[:, 3]]))
    turns = Operations.rotations(axes, np.zeros(3), angles)
    scores = grid.score(Operations.joined([mirrors, turns]).apply(grid.points))
    best, turned = _best(normals, scores[: len(planes)], heads), _best(axes, scores[len(planes) :], turning)
    return Proposals(planes[best], directions[turned], angles[turned])


def _best(directions: FloatArray, scores: FloatArray, count: int) -> list[int]:
    """At most ``count`` rows of the lowest score, well apart; the first ``count`` are those of the main view."""
    scores = np.where(np.arange(len(scores)) < count, _TRUST, 1.0) * scores
    cosines = np.abs(directions @ directions.T)
    kept: list[int] = []
    for row in np.argsort(scores, kind="stable").tolist():
        if len(kept) < count and not (cosines[row, kept] > _APART).any():
            kept.append(row)
    return kept
