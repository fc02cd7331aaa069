"""Lines that may be axes, and the point that several elements have in common."""

import numpy as np

from model.geometry.operations import Operations
from model.types import FloatArray

PARALLEL = float(np.cos(np.deg2rad(4.0)))
"""The cosine of the angle within which two lines count as one."""


def distinct_lines(directions: FloatArray) -> FloatArray:
    """Of directions ``(k, 3)`` those that are not within a few degrees of an earlier one."""
    cosines: list[list[float]] = np.abs(directions @ directions.T).tolist()
    kept: list[int] = []
    for index, row in enumerate(cosines):
        if all(row[other] < PARALLEL for other in kept):
            kept.append(index)
    return directions[kept]


def common_point(operations: Operations, near: FloatArray) -> FloatArray:
    """The point that all operations leave in place, by least squares; where they leave it open, the one ``near``."""
    if not len(operations):
        return near
    fixed = np.eye(3) - operations.matrices
    shifts = np.einsum("kij,kj->ki", fixed, operations.points - near)
    rows = fixed.reshape(-1, 3)
    # The pseudo-inverse without its smallest parts: along an axis, or within a plane, nothing holds the point.
    return near + np.linalg.pinv(rows, rcond=0.02) @ shifts.ravel()


def distances_from(operations: Operations, point: FloatArray) -> FloatArray:
    """How far each element passes by a point: half the way the operation moves it, ``(k,)``."""
    moved = operations.apply(point[None])[:, 0] - point
    return 0.5 * np.sqrt(np.square(moved).sum(1))
