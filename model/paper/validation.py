"""The paper's validation (section 5): which predicted planes and rotations are symmetries, and why others are not."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from model.geometry.surface import SurfaceIndex
from model.geometry.transforms import reflect, rotation_matrix
from model.symmetries import Reason
from model.types import FloatArray

MAX_ERROR = 4e-4
"""The paper's threshold on the symmetry error: an RMS deviation of 2 % of the bounding sphere's diameter."""

DUPLICATE_COSINE = float(np.cos(np.pi / 6))
"""Two planes or axes closer than pi/6 are one; normals have no sign, so |n.n'| is compared."""

SWEEP_DEGREES = 1
"""An axis must hold for every multiple of this angle."""

SWEEP_SAMPLES = 256
"""Samples each angle of the sweep is judged on: 359 angles on all of them would cost a third of a second."""


@dataclass(frozen=True, slots=True)
class Judged:
    """A candidate with its symmetry error; ``reason`` is None when it is accepted.

    ``vector``: a plane ``(n, d)`` ``(4,)`` or the direction of an axis ``(3,)``, unit frame. ``error``: for a plane
    its SDE; for an accepted axis the largest SDE of the sweep; for a rejected axis the SDE of the rotation that failed.
    """

    vector: FloatArray
    error: float
    reason: Reason | None


def validate_planes(
    planes: FloatArray, surface: SurfaceIndex, samples: FloatArray, max_error: float = MAX_ERROR
) -> list[Judged]:
    """Judge planes ``(k, 4)``, rows ``(n, d)``, on ``samples`` ``(n, 3)`` of the surface, all in the unit frame.

    Returns them sorted by error, accepted and rejected alike.
    """
    errors = [surface.mean_squared_distance(reflect(samples, plane)) for plane in planes]
    return _without_duplicates([Judged(p, e, None) for p, e in zip(planes, errors, strict=True)], max_error)


def validate_axes(
    directions: FloatArray,
    angles: FloatArray,
    surface: SurfaceIndex,
    samples: FloatArray,
    max_error: float = MAX_ERROR,
) -> list[Judged]:
    """Judge predicted rotations about axes through the origin of the unit frame.

    The paper looks for surfaces of revolution: the predicted rotation must keep the symmetry, and so must every
    rotation by whole degrees about its axis.

    Args:
        directions: ``(k, 3)`` unit.
        angles: ``(k,)`` radians, the predicted ones.
        surface: the surface to measure against.
        samples: ``(n, 3)`` points on it.
        max_error: threshold on the SDE.

    Returns:
        the candidates sorted by error, accepted and rejected alike.
    """
    judged: list[Judged] = []
    for direction, angle in zip(directions, angles, strict=True):
        error = surface.mean_squared_distance(samples @ rotation_matrix(direction, float(angle)).T)
        if error > max_error:
            judged.append(Judged(direction, error, "not_symmetric"))
            continue
        error, holds = sweep(direction, surface, samples[:: max(1, len(samples) // SWEEP_SAMPLES)], max_error)
        judged.append(Judged(direction, error, None if holds else "not_continuous"))
    return _without_duplicates(judged, max_error)


def sweep(direction: FloatArray, surface: SurfaceIndex, samples: FloatArray, max_error: float) -> tuple[float, bool]:
    """Rotate by every whole degree about an axis through the origin.

    Returns:
        the largest SDE and True, or the first SDE found over ``max_error`` and False.
    """
    worst = 0.0
    for degrees in _coarse_to_fine(360 // SWEEP_DEGREES):
        turned = samples @ rotation_matrix(direction, np.deg2rad(degrees * SWEEP_DEGREES)).T
        error = surface.mean_squared_distance(turned, max_error)
        if error > max_error:
            return surface.mean_squared_distance(turned), False
        worst = max(worst, error)
    return worst, True


def _coarse_to_fine(count: int) -> list[int]:
    """1 .. count - 1, far apart first: a shape that is no surface of revolution fails within a few angles."""
    order: dict[int, None] = {}
    step = count
    while step > 1:
        step = (step + 1) // 2
        order.update(dict.fromkeys(range(step, count, step)))
    return list(order)


def _without_duplicates(judged: Sequence[Judged], max_error: float) -> list[Judged]:
    """Of two candidates closer than pi/6 the worse one goes; whatever exceeds the threshold goes too."""
    kept: list[FloatArray] = []
    result: list[Judged] = []
    for candidate in sorted(judged, key=lambda item: item.error):
        reason = candidate.reason
        if reason is None and candidate.error > max_error:
            reason = "not_symmetric"
        if reason is None and any(abs(candidate.vector[:3] @ other[:3]) > DUPLICATE_COSINE for other in kept):
            reason = "duplicate"
        if reason is None:
            kept.append(candidate.vector)
        result.append(Judged(candidate.vector, candidate.error, reason))
    return result
