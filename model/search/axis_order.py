"""By which angles a shape may be turned about an axis: the order of the axis, or every angle."""

from dataclasses import dataclass

import numpy as np

from model.geometry.operations import Operations
from model.geometry.refinement import squared_distances
from model.geometry.surface import SurfaceIndex
from model.types import FloatArray

ROUND_DEVIATION = 0.0065
"""A faceted circle counts as round if no point strays farther from it, as a part of its radius: between a regular
24-gon (0.86 %), whose order is told, and the 32 segments (0.48 %) with which most programs draw a cylinder."""

SPHERE_DEVIATION = 0.013
"""The same about an axis across the rings of a sphere, where two curvatures add up."""

_LOOSE_DEVIATION = 0.1
"""A scanned or dented vase is round only approximately: RMS deviation as a part of the radius."""

_FLAT = 2.0
"""Such a surface is about equally wrong at every angle; the largest error exceeds the smallest by no more than this."""

_CONTRAST = 0.1
"""A rotation is a symmetry if its error is so much smaller than that of arbitrary angles; else the shape is round."""

_FEW, _SURELY = 8, 4.0
"""A turn that is so many times too bad on every eighth sample is not looked at on all of them."""

ARBITRARY_ANGLES = np.array([1.474, 2.552, 0.539, 2.095, 1.366])
"""Radians. For every order up to 64 one of them is at least 0.33 of a step away from all multiples of the step (found
by random search; multiples of the golden angle come near those of 21 and 34)."""

_PRIMES = (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61)
_LARGEST = 64


@dataclass(frozen=True, slots=True)
class Turns:
    """``order`` of an axis, 1: no turn, None: every angle. ``round_within``: every angle is within the threshold.

    ``exact`` is False for an axis that is round only approximately.
    """

    order: int | None
    round_within: bool
    exact: bool = True


def allowed_turns(
    surface: SurfaceIndex,
    samples: FloatArray,
    direction: FloatArray,
    point: FloatArray,
    *,
    limit: float,
    max_error: float,
    deviation: float = ROUND_DEVIATION,
) -> Turns:
    """Find the order of the axis through ``point`` ``(3,)`` along the unit ``direction`` ``(3,)``, unit frame.

    The order is a product of prime powers, each of which is tried by itself. Two turns of each are looked at: the
    smallest and one half way round, which a nearby wrong order (23 for 24) fails.

    Args:
        surface: what to measure against.
        samples: ``(n, 3)`` points on it.
        direction: of the axis.
        point: on the axis.
        limit: an order must hold within this SDE.
        max_error: largest SDE of an axis that is round only approximately.
        deviation: largest relative deviation of one that is round exactly.
    """
    arm = samples - point
    radii = np.linalg.norm(arm - np.outer(arm @ direction, direction), axis=1)
    squared = _turned(surface, samples, direction, point, ARBITRARY_ANGLES)
    errors = squared.mean(1)
    round_within = bool(errors.max() <= max_error)
    if round_within and np.sqrt(squared.max()) <= deviation * radii.max():
        return Turns(None, True)
    bound = min(limit, _CONTRAST * float(np.median(errors)))
    order = _order(surface, samples, direction, point, bound)
    if order == 1 and round_within:
        flat = errors.max() <= _FLAT * errors.min()
        if flat and errors.max() <= (_LOOSE_DEVIATION * np.sqrt(np.square(radii).mean())) ** 2:
            return Turns(None, True, exact=False)
    return Turns(order, round_within)


def _order(surface: SurfaceIndex, samples: FloatArray, direction: FloatArray, point: FloatArray, bound: float) -> int:
    few = samples[::_FEW]

    def holds(n: int) -> bool:
        angles = 2.0 * np.pi * np.array([1, max(1, n // 2)]) / n
        if _turned(surface, few, direction, point, angles[:1]).mean() > _SURELY * bound:
            return False
        return bool(_turned(surface, samples, direction, point, angles).mean(1).max() <= bound)

    order = 1
    for prime in _PRIMES:
        power = prime
        while order * prime <= _LARGEST and holds(power):
            order *= prime
            power *= prime
    return order


def _turned(
    surface: SurfaceIndex, samples: FloatArray, direction: FloatArray, point: FloatArray, angles: FloatArray
) -> FloatArray:
    """Squared distances ``(angles, n)`` of the turned samples."""
    operations = Operations.rotations(np.tile(direction, (len(angles), 1)), point, angles)
    return squared_distances(surface, samples, operations)
