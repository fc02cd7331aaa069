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
    rotations = Operations.rotations(direction, point, ARBITRARY_ANGLES)
    images = rotations.apply(samples.points)
    ways = meter.surface.closest(images.reshape(-1, 3))[0].reshape(images.shape) - images
    length = np.sqrt(np.square(ways).sum(2, keepdims=True))
    ways *= settings.truncation / np.maximum(length, settings.truncation)
    first, second, _ = frame_of(direction, direction)
    across = images - point
    across -= (across @ direction)[..., None] * direction
    radius = np.sqrt(np.square(across).sum(2))
    outwards = (ways * across).sum(2) / np.maximum(radius, settings.modelling_precision)
    there = ~meter.measure(rotations, samples).missing
    departure = np.where(there, outwards - outwards[there].mean(), 0.0).sum(0) / np.maximum(there.sum(0), 1)
    arm = samples.points - point
    angles = np.arctan2(arm @ second, arm @ first)
    places = np.floor(angles / (2.0 * np.pi) * _PLACES).astype(np.int64) % _PLACES
    waves = np.fft.rfft(np.bincount(places, departure, _PLACES))[2 : settings.largest_order + 1]
    power = np.square(np.abs(waves)) / max(float(np.square(departure).sum()), 1e-300)
    strongest = np.argsort(-power, kind="stable")[:_MOST]
    return [2 + int(order) for order in strongest if power[order] > _POWER]
