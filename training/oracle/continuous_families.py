"""A continuous axis represents a family: every plane through it and every two-fold axis perpendicular to it."""

import numpy as np

from model.types import BoolArray, FloatArray
from training.oracle.alignment import line_distances, perpendicular
from training.oracle.truth import CLEAR_ERROR, TruthAxis

_PARALLEL = np.deg2rad(2.0)
_MEETS = 0.01
_CLOSE = np.deg2rad(5.0)
_BETTER = 0.1
_FEW = 4
"""Members this much better than the family are kept when there are few: a round body may carry a detail that one or two
planes respect. Many are the corners of a tessellation."""


def of_family(axis: TruthAxis, lying: BoolArray, errors: FloatArray) -> BoolArray:
    """Which of the elements ``(k,)`` near a continuous axis belong to its family; ``errors`` are theirs."""
    better = lying & (errors < _BETTER * axis.error) & (axis.error >= _BETTER * CLEAR_ERROR)
    return lying if better.sum() > _FEW else lying & ~better


def planes_through(axis: TruthAxis, rows: FloatArray) -> BoolArray:
    """Which of the planes ``(k, 4)`` hold the axis."""
    along = np.abs(rows[:, :3] @ axis.direction) < np.sin(_PARALLEL)
    return along & (np.abs(rows[:, :3] @ axis.point + rows[:, 3]) < _MEETS)


def across(axis: TruthAxis, other: TruthAxis) -> bool:
    """Whether the other axis crosses this one at a right angle."""
    if abs(float(axis.direction @ other.direction)) > np.sin(_PARALLEL):
        return False
    normal = np.cross(axis.direction, other.direction)
    return abs(float((axis.point - other.point) @ normal)) < _MEETS


def sphere_centre(axes: list[TruthAxis]) -> FloatArray | None:
    """The centre of a sphere: where two clear continuous axes meet that are not parallel; None if there are none."""
    round_ = [axis for axis in axes if axis.order is None and axis.error < CLEAR_ERROR]
    for first in round_[:1]:
        for second in round_[1:]:
            if abs(float(first.direction @ second.direction)) < np.cos(np.deg2rad(10.0)):
                apart = line_distances(first.direction[None], first.point[None], second.point[None])
                if apart[0, 0] < np.inf:
                    return (first.point + second.point) / 2.0
    return None


def family_planes(axis: TruthAxis, rows: FloatArray, errors: FloatArray) -> FloatArray:
    """Two perpendicular planes through a continuous axis ``(2, 4)``, the first the best of the rows that hold it."""
    through = planes_through(axis, rows)
    if through.any():
        best = rows[through][np.argmin(errors[through])]
        first = best[:3] - (best[:3] @ axis.direction) * axis.direction
        first /= np.linalg.norm(first)
    else:
        first = perpendicular(axis.direction[None])[0][0]
    normals: FloatArray = np.stack([first, np.cross(axis.direction, first).astype(np.float64)])
    return np.column_stack([normals, -normals @ axis.point])


def surplus_planes(axes: list[TruthAxis], rows: FloatArray, errors: FloatArray) -> BoolArray:
    """Which of the clear planes ``(k, 4)`` are redundant: an axis of order n lies in at most n planes.

    A round table on four thin legs is symmetric within the limit in many planes; four of them are meant.
    """
    redundant = np.zeros(len(rows), dtype=bool)
    for axis in axes:
        if axis.order is not None and axis.error < CLEAR_ERROR:
            through = np.flatnonzero(planes_through(axis, rows) & (errors < CLEAR_ERROR))
            redundant[through[np.argsort(errors[through], kind="stable")[axis.order :]]] = True
    # Planes at a small angle to each other make rotations by twice that angle: without such an axis one is merely
    # similar.
    many = [planes_through(axis, rows) for axis in axes if axis.order is None or axis.order * _CLOSE >= np.pi]
    for better, worse in zip(*np.nonzero(errors[:, None] < errors), strict=True):
        close = abs(float(rows[better, :3] @ rows[worse, :3])) > np.cos(_CLOSE)
        if close and not redundant[better] and errors[worse] < CLEAR_ERROR:
            redundant[worse] |= not any(through[better] and through[worse] for through in many)
    return redundant


def surplus_axes(axes: list[TruthAxis]) -> list[bool]:
    """Which of the axes are too many: one of order n is crossed by at most n clear two-fold axes."""
    redundant = [False] * len(axes)
    for axis in axes:
        if axis.order is not None and axis.error < CLEAR_ERROR:
            crossing = [i for i, other in enumerate(axes)
                        if other.order == 2 and other.error < CLEAR_ERROR and across(axis, other)]  # fmt: skip
            for index in sorted(crossing, key=lambda i: axes[i].error)[axis.order :]:
                redundant[index] = True
    return redundant
