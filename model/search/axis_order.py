"""By which angles a shape may be rotated about an axis: the order of the axis, or every angle."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from model.geometry.operations import Operations
from model.search.deviation import DeviationMeter, Deviations, SurfaceSamples
from model.search.point_groups import ARBITRARY_ANGLES
from model.search.settings import DEFAULT, SearchSettings
from model.types import FloatArray

_SCREEN_STRIDE, _SCREEN_FACTOR = 8, 4.0
"""A rotation that is so many times too bad on every eighth sample is not looked at on all of them."""

_ALWAYS = 7
"""Orders up to this are tried whatever arbitrary angles give."""

_FACET_SLACK = 1.5

_SHARES = (0.5, 0.34, 0.42, 0.27, 0.22)
"""Of a full turn: the angles at which an order is looked at."""

_CONTRAST = 0.1
"""A rotation is a symmetry if its squared deviation is so much smaller than that of arbitrary angles. Larger ones must
be smaller significantly (`explains_better`)."""

_PRIMES = tuple(n for n in range(2, DEFAULT.largest_order + 1) if all(n % p for p in range(2, int(n**0.5) + 1)))


@dataclass(frozen=True, slots=True)
class RotationalSymmetry:
    """What rotations about an axis are symmetries.

    ``order``: 1 where none is, None where the surface is round up to its facets. ``arbitrary_rms``: the largest RMS
    deviation over a few arbitrary angles: within the threshold, the surface is round at least roughly.
    """

    order: int | None
    arbitrary_rms: float


@dataclass(frozen=True, slots=True, eq=False)
class Roundness:
    """How round a surface is about an axis: its ``deviations`` at arbitrary angles, and its ``radius``, unit frame.

    ``is_round``: it strays no farther from round than its facets allow.
    """

    deviations: Deviations
    radius: float
    is_round: bool

    @property
    def rms(self) -> float:
        """The largest RMS deviation over the angles."""
        return float(self.deviations.rms.max())


def roundness(
    meter: DeviationMeter,
    samples: SurfaceSamples,
    direction: FloatArray,
    point: FloatArray,
    settings: SearchSettings = DEFAULT,
) -> Roundness:
    """Whether every rotation about the axis through ``point`` ``(3,)`` along the unit ``direction`` ``(3,)`` holds."""
    radius = samples.radius_about(direction, point)
    deviations = meter.measure(Operations.rotations(direction, point, ARBITRARY_ANGLES), samples)
    there = np.where(deviations.missing, 0.0, deviations.squared)
    unsupported = float(deviations.missing.all(0).mean())
    # The facets of a surface that cannot be round are not asked for.
    is_round = bool(
        np.sqrt(there.max()) <= settings.round_deviation * radius
        and unsupported <= settings.most_unsupported
        and (there <= np.square(facet_tolerance(meter, samples, radius, settings.round_deviation, settings))).all()
    )
    return Roundness(deviations, radius, is_round)


def rotation_order(
    meter: DeviationMeter,
    samples: SurfaceSamples,
    direction: FloatArray,
    point: FloatArray,
    *,
    limit: float,
    past_facets: bool = False,
    settings: SearchSettings = DEFAULT,
) -> RotationalSymmetry:
    """Find the order of the axis through ``point`` ``(3,)`` along the unit ``direction`` ``(3,)``, unit frame.

    The order is a product of prime powers, each of which is tried by itself, at up to five angles far from the
    smallest, which a nearby wrong order (23 for 24) fails.

    Args:
        meter: what to measure with.
        samples: points on the surface.
        direction: of the axis.
        point: on the axis.
        limit: an order must hold within this RMS deviation.
        past_facets: what facets allow is taken off all deviations: of a gear with a bore the order of the gear shows.
        settings: the thresholds.
    """
    arbitrary = roundness(meter, samples, direction, point, settings)
    if arbitrary.is_round:
        return RotationalSymmetry(None, arbitrary.rms)
    allowed = np.zeros(len(samples))
    if past_facets:
        allowed = np.minimum(
            _FACET_SLACK * meter.facets.at(samples.owners), settings.round_deviation * arbitrary.radius
        )
    reference = _excess(arbitrary.deviations.squared, allowed, settings.truncation).mean(0)
    if not reference.any():
        return RotationalSymmetry(1, arbitrary.rms)
    # Half a step of the order n moves no point farther than this share of the radius: more is not round enough for it.
    largest = np.pi * arbitrary.radius / max(arbitrary.rms, 1e-12)
    order = _order(meter, samples, direction, point, limit, reference, allowed, largest, settings)
    return RotationalSymmetry(order, arbitrary.rms)


def _excess(squared: FloatArray, allowed: FloatArray, truncation: float) -> FloatArray:
    """Squared deviations ``(k, n)`` without what is allowed at each sample ``(n,)``, truncated."""
    return np.square(np.minimum(np.maximum(np.sqrt(squared) - allowed, 0.0), truncation))


def facet_tolerance(
    meter: DeviationMeter,
    samples: SurfaceSamples,
    radius: float,
    deviation: float,
    settings: SearchSettings = DEFAULT,
) -> FloatArray:
    """How far samples ``(n,)`` of a round surface may stray from round, being on facets: ``(n,)``, unit frame.

    Facets are as far from round as their edges are smooth, and no farther than a share ``deviation`` of the radius:
    what is drawn with fewer segments is angular on purpose. Teeth, however small, are no facets.
    """
    sagittas = _FACET_SLACK * meter.facets.at(samples.owners)
    return np.minimum(np.maximum(sagittas, settings.modelling_precision), deviation * radius)


def explains_better(squared: FloatArray, others: FloatArray, settings: SearchSettings = DEFAULT) -> bool:
    """Whether one hypothesis explains a surface distinctly better than another one.

    Args:
        squared: ``(n,)`` squared deviations of the first at n samples.
        others: ``(n,)`` those of the other at the same samples.
        settings: ``significance`` and ``advantage``.
    """
    difference = others - squared
    spread = float(difference.std()) / np.sqrt(len(difference))
    enough = float(others.mean()) > settings.advantage * float(squared.mean())
    return enough and float(difference.mean()) > settings.significance * spread


def _order(
    meter: DeviationMeter,
    samples: SurfaceSamples,
    direction: FloatArray,
    point: FloatArray,
    limit: float,
    reference: FloatArray,
    allowed: FloatArray,
    largest: float,
    settings: SearchSettings,
) -> int:
    few = samples.every(_SCREEN_STRIDE)
    coarse_bound = _SCREEN_FACTOR * min(limit * limit, float(reference.mean()))

    def promising(orders: list[int]) -> list[int]:
        angles = np.array([2.0 * np.pi * _multiples(n)[0] / n for n in orders])
        screened = meter.measure(Operations.rotations(direction, point, angles), few)
        there = np.where(screened.missing, 0.0, screened.squared)
        errors = _excess(there, allowed[::_SCREEN_STRIDE], settings.truncation).mean(1)
        return [n for n, error in zip(orders, errors.tolist(), strict=True) if error <= coarse_bound]

    def holds(n: int) -> bool:
        worst = np.zeros(len(samples))
        for multiple in _multiples(n).tolist():  # one at a time: the first tells most of those apart that do not hold
            angle = np.array([2.0 * np.pi * multiple / n])
            deviations = meter.measure(Operations.rotations(direction, point, angle), samples)
            if deviations.rms[0] > limit:
                return False
            excess = _excess(deviations.squared, allowed, settings.truncation)[0]
            worst = excess if excess.mean() > worst.mean() else worst
            small = float(worst.mean()) <= _CONTRAST * float(reference.mean())
            if not small and not explains_better(worst, reference, settings):
                return False
        return True

    order = 1
    for prime in promising([prime for prime in _PRIMES if prime <= max(largest, _ALWAYS)]):
        power = prime
        while order * prime <= settings.largest_order and (power == prime or promising([power])) and holds(power):
            order *= prime
            power *= prime
    return order


@lru_cache(maxsize=512)
def _multiples(n: int) -> FloatArray:
    """Multiples of the smallest rotation that generate all of them and are far from it.

    Rotations by a small angle prove nothing: bumps and noise are moved by less than their size.
    """
    prime = [k for k in range(1, n) if np.gcd(k, n) == 1]
    return np.array(sorted({min(prime, key=lambda k: abs(k - share * n)) for share in _SHARES}), dtype=np.float64)
