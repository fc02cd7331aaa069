"""A symmetry beside the same element a little aside: where these do as well, the shape is a lump."""

import numpy as np

from model.geometry.operations import Operations
from model.search.point_groups import frame_of
from model.types import FloatArray

_ARM = 0.25
"""Turning moves typical points of the unit frame by this share of the angle; an inversion is shifted as far."""

_ACROSS = 0.1
"""Cosine to an axis below which a direction is across it."""


def tilted(element: Operations, angle: float, axis: FloatArray | None = None) -> Operations:
    """One operation (a batch of one) with its element tilted by an angle, radians, either way about several lines.

    An inversion, which has no direction, is shifted instead.

    Args:
        element: the operation.
        angle: radians.
        axis: direction ``(3,)`` of an axis of order 3 at least of its group. What lies across it is tilted towards it
            alone: turned about it, it may be another member.
    """
    first, second, third = frame_of(element.directions[0], element.directions[0])
    if element.improper[0] and element.angles[0] > 3.0:
        lines = np.stack([first, second, third])
        turns, shifts = np.zeros((6, 3)), angle * _ARM * np.concatenate([lines, -lines])
    else:
        lines = np.stack([first, second, (first + second) * 0.5**0.5, (first - second) * 0.5**0.5])
        if axis is not None and abs(float(axis @ element.directions[0])) < _ACROSS:
            lines = np.asarray(np.cross(axis, element.directions[0]), dtype=np.float64)[None]
        turns = angle * np.concatenate([lines, -lines])
        shifts = np.zeros_like(turns)
    copies = element[[0] * len(turns)]
    moved = copies.moved(turns, shifts)
    if not shifts.any():
        moved = Operations(moved.directions, copies.points, copies.angles, copies.improper)
    return moved
