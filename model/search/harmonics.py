"""Which orders show in how a nearly round surface departs from round: the harmonics of its departures about an axis.

Of a regular polygon of sixteen corners under noise no single rotation is much better than others. But its corners stand
at equal angles, and that adds up over all samples: a Fourier coefficient far above what noise gives.
"""

import numpy as np

from model.geometry.operations import Operations
from model.search.deviation import DeviationMeter, SurfaceSamples
from model.search.point_groups import ARBITRARY_ANGLES, frame_of
from model.search.settings import DEFAULT, SearchSettings
from model.types import FloatArray

HARMONICS_STRIDE = 3
"""Of many samples every so many-th are enough."""

_POWER = 9.0
"""Of noise, one coefficient in e to this has as many times the mean power: one of 22 axes has one of 360."""

_MOST, _PLACES = 4, 4096


def harmonics(
    meter: DeviationMeter,
    samples: SurfaceSamples,
    direction: FloatArray,
    point: FloatArray,
    settings: SearchSettings = DEFAULT,
) -> list[int]:
    """The orders of the strongest harmonics about an axis, at least 2, the strongest first; none if all may be noise.

    Args:
        meter: what to measure with.
        samples: n points on the surface.
        direction: of the axis, ``(3,)`` unit.
        point: on the axis ``(3,)``.
        settings: the largest order, and how far distances count.
    """
    outwards, seen = np.zeros(len(samples)), np.zeros(len(samples), dtype=np.int64)
    for angle in ARBITRARY_ANGLES:
        rotation = Operations.rotations(direction, point, angle)
        images = rotation.apply(samples.points)[0]
        ways = meter.surface.closest(images)[0] - images
        across = images - point
        across -= np.outer(across @ direction, direction)
        length = np.maximum(np.sqrt(np.square(ways).sum(1)), settings.truncation)
        radius = np.maximum(np.sqrt(np.square(across).sum(1)), settings.modelling_precision)
        there = ~meter.measure(rotation, samples).missing[0]
        outwards[there] += ((ways * across).sum(1) / radius * settings.truncation / length)[there]
        seen += there
    departure = np.where(seen > 0, (outwards - seen * outwards.sum() / max(seen.sum(), 1)) / np.maximum(seen, 1), 0.0)
    first, second, _ = frame_of(direction, direction)
    arm = samples.points - point
    angles = np.arctan2(arm @ second, arm @ first)
    places = np.floor(angles / (2.0 * np.pi) * _PLACES).astype(np.int64) % _PLACES
    waves = np.fft.rfft(np.bincount(places, departure, _PLACES))[2 : settings.largest_order + 1]
    power = np.square(np.abs(waves)) / max(float(np.square(departure).sum()), 1e-300)
    strongest = np.argsort(-power, kind="stable")[:_MOST]
    return [2 + int(order) for order in strongest if power[order] > _POWER]
