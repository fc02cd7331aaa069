"""Products of found symmetries, which are symmetries again: candidates that no start may have reached."""

import numpy as np

from model.geometry.transforms import reflection_homogeneous, rotation_homogeneous
from model.types import BoolArray, FloatArray, IntArray
from training.oracle.alignment import Axes, axes_of, line_distances
from training.oracle.truth import TruthAxis

SAME_ANGLE = np.deg2rad(1.0)
SAME_SHIFT = 0.01
_MOST_MATRICES = 150
_LEAST_TURN = np.deg2rad(4.0)
_LARGEST_SHIFT = 0.02
"""Products of approximate symmetries may translate a little along the axis, or rotate a little while they mirror."""


def isometries(planes: FloatArray, axes: list[TruthAxis]) -> FloatArray:
    """``(g, 4, 4)`` matrices: reflections in ``(p, 4)`` planes, powers of the rotations about axes of finite order."""
    powers = [list(range(1, axis.order)) for axis in axes if axis.order]
    finite = [axis for axis in axes if axis.order]
    if len(planes) + sum(map(len, powers)) > _MOST_MATRICES:
        powers = [sorted({1, 2, max(len(few) // 2, 1)} & set(few)) for few in powers]
    matrices = [reflection_homogeneous(plane) for plane in planes]
    for axis, several in zip(finite, powers, strict=True):
        step = 2.0 * np.pi / (axis.order or 1)
        matrices += [rotation_homogeneous(axis.direction, axis.point, power * step) for power in several]
    return np.array(matrices).reshape(-1, 4, 4)


def products(planes: FloatArray, axes: list[TruthAxis]) -> tuple[FloatArray, Axes]:
    """Planes ``(k, 4)`` and axes of all products of two found symmetries, known ones and repetitions among them.

    Of an improper product the axis of its square is taken.
    """
    given = isometries(planes, axes)
    every = np.einsum("gij,hjk->ghik", given, given).reshape(-1, 4, 4)
    linear, shifts = every[:, :3, :3], every[:, :3, 3]
    improper = np.linalg.det(linear) < 0.0
    mirrors = improper & (np.trace(linear, axis1=1, axis2=2) > 0.98)
    normals = np.linalg.eigh(linear[mirrors] + linear[mirrors].transpose(0, 2, 1))[1][:, :, 0]
    rows = np.column_stack([normals, -np.einsum("ki,ki->k", normals, shifts[mirrors]) / 2.0])
    squares = every[improper & ~mirrors]
    rotations = np.concatenate([every[~improper], squares @ squares])
    found = axes_of(rotations[:, :3, :3], rotations[:, :3, 3])
    slip = np.abs(np.einsum("ki,ki->k", found.directions, rotations[:, :3, 3]))
    return rows, found.take((found.angles[:, 0] > _LEAST_TURN) & (slip < _LARGEST_SHIFT))


def same_planes(
    rows: FloatArray, others: FloatArray, angle: float = SAME_ANGLE, shift: float = SAME_SHIFT
) -> BoolArray:
    """Which of the planes ``(k, 4)`` are which of the others ``(l, 4)``, ``(k, l)``; normals have no sign."""
    cosines = rows[:, :3] @ others[:, :3].T
    signs = np.where(cosines < 0.0, -1.0, 1.0)
    return (np.abs(cosines) > np.cos(angle)) & (np.abs(rows[:, 3:] - signs * others[:, 3]) < shift)


def same_axes(axes: Axes, others: Axes, angle: float = SAME_ANGLE, shift: float = SAME_SHIFT) -> BoolArray:
    """Which of the axes are the same lines as which of the others, ``(k, l)``; directions have no sign."""
    cosines = np.abs(axes.directions @ others.directions.T)
    return (cosines > np.cos(angle)) & (line_distances(axes.directions, axes.points, others.points) < shift)


def distinct(same: BoolArray, errors: FloatArray) -> IntArray:
    """Indices of candidates none of which is the same as a better one, best first; ``same`` is ``(k, k)``."""
    kept: list[int] = []
    open_ = np.ones(len(errors), dtype=bool)
    for index in np.argsort(errors, kind="stable"):
        if open_[index]:
            kept.append(int(index))
            open_ &= ~same[index]
    return np.array(kept, dtype=np.int32)


def as_moves(axes: list[TruthAxis]) -> Axes:
    """Lines of axes, to compare them; no angles."""
    directions = np.array([axis.direction for axis in axes]).reshape(-1, 3)
    return Axes(directions, np.array([axis.point for axis in axes]).reshape(-1, 3), np.zeros((len(axes), 1)), True)


def joined(*parts: Axes) -> Axes:
    """One batch of several."""
    return Axes(
        np.concatenate([part.directions for part in parts]),
        np.concatenate([part.points for part in parts]),
        np.concatenate([part.angles for part in parts]),
        True,
    )
