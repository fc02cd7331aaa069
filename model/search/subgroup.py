"""The part of a group that is exact where the group as a whole is not: of a plate with a chamfered corner, say."""

import numpy as np

from model.geometry.operations import Operations
from model.search import closure
from model.search.exactness import Verdict
from model.search.hypothesis import Hypothesis
from model.search.point_groups import identify, point_group

_MOST_MEMBERS = 130
"""Groups with more operations are not taken apart."""


def exact_part(verdict: Verdict) -> Hypothesis | None:
    """The largest group of those operations of a group that hold everywhere, where it is; None if none does.

    Args:
        verdict: on the group, by its generators and elements.
    """
    level = verdict.hypothesis
    if verdict.exact or not 1 < len(level.matrices) <= _MOST_MEMBERS:
        return None
    operations = _operations(level)
    _, fits = verdict.of(operations)
    if not fits.any():
        return None
    members = closure.closure(operations.matrices[fits])
    identified = None if members is None or len(members) == len(level.matrices) else identify(members)
    if identified is None:
        return None
    name, frame = identified
    return None if name == "C1" else Hypothesis(point_group(name), frame, level.centre)


def _operations(level: Hypothesis) -> Operations:
    """All that elements can hold alone: reflections, rotations of every order that divides an axis', the inversion."""
    group, centre = level.group, level.centre
    parts = [Operations.reflections(level.planes)]
    for direction, order in zip(level.directions, group.orders, strict=True):
        angles = np.array([2.0 * np.pi / n for n in range(2, order + 1) if order % n == 0])
        parts.append(Operations.rotations(direction, centre, angles))
    if (np.trace(level.matrices, axis1=1, axis2=2) < -2.9).any():
        parts.append(Operations(np.eye(3)[:1], centre[None], np.array([np.pi]), np.ones(1, dtype=np.bool_)))
    return Operations.joined(parts)
