"""How a nearly round surface departs from round about an axis: harmonics tell which orders show, their phases where.

Of a regular polygon of sixteen corners under noise no single rotation is much better than others. But its corners stand
at equal angles, and that adds up over all samples: a Fourier coefficient far above what noise gives.
"""

from dataclasses import dataclass

import numpy as np

from model.geometry.operations import Operations
from model.search.deviation import DeviationMeter, SurfaceSamples
from model.search.point_groups import ARBITRARY_ANGLES, frame_of
from model.search.settings import DEFAULT, SearchSettings
from model.types import ComplexArray, FloatArray

HARMONICS_STRIDE = 3
"""Of many samples every so many-th are enough."""

_POWER = 9.0
"""Of noise, one coefficient in e to this has as many times the mean power: one of 22 axes has one of 360."""

_MOST, _OVERTONES, _PLACES = 4, 3, 4096


@dataclass(frozen=True, slots=True, eq=False)
class Harmonics:
    """The departures from round about an axis as a Fourier series, up to the largest order.

    ``frame`` ``(3, 3)``: a proper rotation, its last row the axis; angles are measured from its first row to its
    second. ``waves`` ``(m,)`` complex: coefficients of the radius, up to one factor. ``power`` ``(m,)``: of each in the
    departures, as a multiple of what noise has on average.
    """

    frame: FloatArray
    waves: ComplexArray
    power: FloatArray

    @property
    def orders(self) -> list[int]:
        """The orders of the strongest harmonics, at least 2, the strongest first; none if all may be noise."""
        strongest = 2 + np.argsort(-self.power[2:], kind="stable")[:_MOST]
        return [int(order) for order in strongest if self.power[order] > _POWER]

    def mirrored_at(self, order: int) -> list[FloatArray]:
        """Directions ``(3,)`` across an axis of an order that planes through it may lie along; none if all is noise.

        A wave is symmetric about its crests and troughs. Those of the strongest harmonic that the order divides.
        """
        multiples = np.arange(order, min(_OVERTONES * order, len(self.power) - 1) + 1, order)
        strongest = int(multiples[np.argmax(self.power[multiples])]) if len(multiples) else 0
        if strongest == 0 or self.power[strongest] <= _POWER:
            return []
        crest = -float(np.angle(self.waves[strongest])) / strongest
        angles = crest + np.pi / strongest * np.arange(strongest // order)
        return [np.cos(angle) * self.frame[0] + np.sin(angle) * self.frame[1] for angle in angles.tolist()]


def harmonics(
    meter: DeviationMeter,
    samples: SurfaceSamples,
    direction: FloatArray,
    point: FloatArray,
    settings: SearchSettings = DEFAULT,
) -> Harmonics:
    """How a surface departs from round about an axis.

    What is compared with the surface are its images under arbitrary rotations: the way from an image outwards to the
    surface is the radius there less the radius where the sample was.

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
    frame = frame_of(direction, direction)
    arm = samples.points - point
    angles = np.arctan2(arm @ frame[1], arm @ frame[0])
    places = np.floor(angles / (2.0 * np.pi) * _PLACES).astype(np.int64) % _PLACES
    waves = np.fft.rfft(np.bincount(places, departure, _PLACES))[: settings.largest_order + 1]
    power = np.square(np.abs(waves)) / max(float(np.square(departure).sum()), 1e-300)
    # The departures are those of the radius, turned and taken off: of each harmonic a known factor.
    turned = np.exp(1j * np.outer(ARBITRARY_ANGLES, np.arange(len(waves)))).mean(0) - 1.0
    return Harmonics(frame, np.conj(turned) * waves, power)
