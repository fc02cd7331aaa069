"""A symmetry beside the same element a little aside: where these do as well, the shape is a lump."""

import numpy as np

from model.geometry.operations import Operations
from model.search.point_groups import CONTINUOUS, frame_of
from model.types import BoolArray

_ARM = 0.25
"""Turning moves typical points of the unit frame by this share of the angle; an inversion is shifted as far."""


def can_be_tilted(name: str, operations: Operations) -> BoolArray:
    """Which operations of a group are others when they are tilted: of a round one the rotations, of a sphere none.

    Args:
        name: of the group.
        operations: k of its members.
    """
    if name == "Kh":
        return np.zeros(len(operations), dtype=np.bool_)
    return ~operations.improper if name in CONTINUOUS else np.ones(len(operations), dtype=np.bool_)


def tilted(element: Operations, angle: float) -> Operations:
    """One operation (a batch of one) with its element tilted by an angle, radians, either way about several lines.

    An inversion, which has no direction, is shifted instead.
    """
    first, second, third = frame_of(element.directions[0], element.directions[0])
    if element.improper[0] and element.angles[0] > 3.0:
        lines = np.stack([first, second, third])
        turns, shifts = np.zeros((6, 3)), angle * _ARM * np.concatenate([lines, -lines])
    else:
        lines = np.stack([first, second, (first + second) * 0.5**0.5, (first - second) * 0.5**0.5])
        turns = angle * np.concatenate([lines, -lines])
        shifts = np.zeros_like(turns)
    copies = element[[0] * len(turns)]
    moved = copies.moved(turns, shifts)
    if not shifts.any():
        moved = Operations(moved.directions, copies.points, copies.angles, copies.improper)
    return moved
