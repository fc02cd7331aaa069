"""The order of a rotation axis: how many rotations about it map a surface to itself, or whether every angle does.

The mean squared error alone cannot tell a prism over a regular 24-gon from a finely cut cylinder: both hold for every
angle to 2e-6. What tells them apart is the contrast between the angles that hold and those half-way between, and how
far a rotated surface departs from itself, measured against the distance from the axis.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from model.types import FloatArray
from training.oracle.alignment import Axes, Surface
from training.oracle.truth import CLEAR_ERROR

ROUND_DEVIATION = 0.0065
"""A rotated surface that departs from itself by less than this share of the local radius is round: a regular polygon
of 28 corners is (1 - cos(π/28) = 0.63 %), one of 27 is not."""
_ROUND_POLYGON = 28
_ANGULAR = 0.5
"""With this share of the deviation of a regular polygon of its order a shape is that polygon, and no sloppy circle."""
_FEW, _MANY = 32, 128
"""Orders tried on every axis, and on those that are round at first sight (error at most `_ROUND_AT_SIGHT`)."""
_ROUND_AT_SIGHT = 1e-5
_CONTRAST = 2.0
"""Half-way between two angles that hold, the error is at least this much larger."""
_STRONG_CONTRAST, _STRONGER_CONTRAST, _CORNERS = 3.0, 10.0, 8
"""Strong below this number of corners. Stronger from there on and where every angle is clear, as all is round there."""
_NOISE = 1e-10
"""Errors below this are rounding of coordinates: they show no contrast."""
_SAME_QUALITY = 1e-7
"""Of several orders that hold, the largest counts whose error is at most four times the smallest, or a multiple of it
whose error is below this and in strong contrast to what is between."""


class Turn(NamedTuple):
    """The ``order`` of an axis (None: every angle holds), the largest ``error`` of the rotations that were tried."""

    order: int | None
    error: float


def turn_errors(
    direction: FloatArray, point: FloatArray, angles: FloatArray, samples: FloatArray, surface: Surface
) -> FloatArray:
    """Symmetry errors ``(a,)`` of the rotations by ``(a,)`` ``angles`` about one axis, on ``(m, 3)`` samples."""
    count = len(angles)
    rotations = Axes(np.tile(direction, (count, 1)), np.tile(point, (count, 1)), angles[:, None])
    return surface.errors(rotations.images(samples))


def turn_of(
    direction: FloatArray, point: FloatArray, samples: FloatArray, many: FloatArray, surface: Surface, limit: float
) -> Turn | None:
    """The order of an axis; None if it is no rotation axis.

    Args:
        direction: unit vector (3,).
        point: a point (3,) on the axis.
        samples: ``(m, 3)`` surface samples, some 150 of them.
        many: ``(l, 3)`` more of them, for what only round shapes are asked.
        surface: the surface.
        limit: the largest symmetry error of a rotation that holds.
    """

    def errors(angles: FloatArray) -> FloatArray:
        return turn_errors(direction, point, angles, samples, surface)

    orders = range(2, _FEW + 1)
    once = errors(_turns(orders))
    holding = [_held(order, error, errors) for order, error in zip(orders, once, strict=True) if error <= limit]
    worst = float(once.max())
    if worst <= _ROUND_AT_SIGHT:
        orders = range(_FEW + 1, _MANY + 1)
        holding += [_held(order, error, errors) for order, error in zip(orders, errors(_turns(orders)), strict=True)]
    if worst <= limit:
        # Angles no small order has: the largest error over the sweep.
        worst = max(worst, float(errors(_between(11, 0.38, 23)).max()))
    contrast = _CONTRAST if worst > CLEAR_ERROR else _STRONGER_CONTRAST
    found = [one for one in holding if one.contrast >= contrast and one.error <= limit]
    discrete = None
    if found:
        best = 4.0 * min(one.error for one in found)
        discrete = max((one for one in found if one.error <= best), key=lambda one: one.order)
        for one in found:
            strong = _STRONG_CONTRAST if one.order < _CORNERS else _STRONGER_CONTRAST
            if one.order % discrete.order == 0 and one.error <= _SAME_QUALITY and one.contrast >= strong:
                discrete = one
    if discrete is None:
        return Turn(None, worst) if worst <= limit else None
    order, error = discrete.order, discrete.error
    if worst <= (_ROUND_AT_SIGHT if order >= _ROUND_POLYGON else CLEAR_ERROR):
        deviation = relative_deviation(direction, point, many, surface)
        angular = order < _ROUND_POLYGON and deviation >= _ANGULAR * (1.0 - np.cos(np.pi / order))
        if deviation <= ROUND_DEVIATION and not angular:
            return Turn(None, worst)
    return Turn(order, error)


def _turns(orders: range) -> FloatArray:
    return np.array([2.0 * np.pi / order for order in orders])


def _between(count: int, less: float, share: int) -> FloatArray:
    """Angles that no small order has."""
    return np.array([2.0 * np.pi * (index - less) / share for index in range(1, count + 1)])


class _Held(NamedTuple):
    order: int
    error: float
    contrast: float


def _held(order: int, once: float, errors: Callable[[FloatArray], FloatArray]) -> _Held:
    """How well rotations by 2π/``order`` hold, and how much better than those half-way between."""
    step = 2.0 * np.pi / order
    again, half, further = errors(np.array([order // 2, 0.5, 1.5]) * step)
    error = max(float(once), float(again))
    return _Held(order, error, min(float(half), float(further)) / max(error, _NOISE / _CONTRAST))


def relative_deviation(direction: FloatArray, point: FloatArray, samples: FloatArray, surface: Surface) -> float:
    """How far the surface departs from itself when rotated, as a share of the local distance from the axis.

    Radial distances over some angles; the 98th percentile, so that a scratch does not make a cylinder angular. Parts
    close to the axis, or perpendicular to it, say nothing and are left out.
    """
    angles = _between(24, 0.41, 29)
    count = len(angles)
    rotations = Axes(np.tile(direction, (count, 1)), np.tile(point, (count, 1)), angles[:, None])
    images = rotations.images(samples)
    signed, ways = surface.residuals(images)
    arms = images - point
    arms -= (arms @ direction)[..., None] * direction
    radii = np.linalg.norm(arms, axis=2)
    steepness = np.abs(np.einsum("kmi,kmi->km", ways, arms)) / np.maximum(radii, 1e-12)
    informative = (radii > 0.1 * radii.max()) & (steepness > 0.1)
    if not informative.any():
        return 0.0
    return float(np.percentile(np.abs(signed[informative]) / (radii[informative] * steepness[informative]), 98))
