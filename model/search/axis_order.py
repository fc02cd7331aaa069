"""By which angles a shape may be rotated about an axis: the order of the axis, or every angle."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from model.geometry.operations import Operations
from model.search.comparison import explains_better, mean_where, might_explain_better
from model.search.deviation import DeviationMeter, Deviations, SurfaceSamples
from model.search.harmonics import HARMONICS_STRIDE, harmonics
from model.search.point_groups import ARBITRARY_ANGLES
from model.search.settings import DEFAULT, SearchSettings
from model.types import FloatArray, IntArray

_SCREEN_STRIDE, _SCREEN_FACTOR, _SCREEN_SIGNIFICANCE = 8, 4.0, 1.0
"""A rotation that is so many times too bad on every eighth sample, or hardly better there than arbitrary ones (by less
than so many standard errors), is not looked at on all of them."""

_ALWAYS = 7
"""Orders up to this are tried whatever arbitrary angles give."""

_FACET_SLACK = 1.5

_SHARES = (0.5, 0.34, 0.42, 0.27, 0.22)
"""Of a full turn: the angles at which an order is looked at."""

_CONTRAST = 0.1
"""A rotation is a symmetry if its squared deviation is so much smaller than that of arbitrary angles. Larger ones must
be smaller significantly (`explains_better`)."""

_AS_GOOD = 0.35
"""All rotations of one axis are as good: of the way from the best of them to arbitrary ones no other is farther."""

PRIMES = np.array([n for n in range(2, DEFAULT.largest_order + 1) if all(n % p for p in range(2, int(n**0.5) + 1))])
"""All orders are products of these."""


@dataclass(frozen=True, slots=True)
class RotationalSymmetry:
    """What rotations about an axis are symmetries.

    ``order``: the one that was ``known`` where there is no higher one, None where the surface is round up to its
    facets. ``arbitrary_rms``: the largest RMS deviation over a few arbitrary angles: within the threshold, the surface
    is round at least roughly. ``needed``: within a smaller RMS deviation nothing more than the order holds.
    """

    order: int | None
    arbitrary_rms: float
    needed: float


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
    known: int = 1,
    primes: IntArray = PRIMES,
    past_facets: bool = False,
    many: Callable[[], SurfaceSamples] | None = None,
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
        known: the order that the axis has at least; multiples of it are looked for.
        primes: factors that the order may have.
        past_facets: what facets allow is taken off all deviations: of a gear with a bore the order of the gear shows.
        many: gives more samples, asked where the others do not tell an order from noise.
        settings: the thresholds.
    """
    axis = _Axis(meter, direction, point, limit, past_facets, many, settings)
    few = samples.every(_SCREEN_STRIDE)
    arbitrary = roundness(meter, few, direction, point, settings)
    powers = {prime: _next_power(prime, known) for prime in primes.tolist()}
    if many is not None and not arbitrary.is_round and arbitrary.rms <= limit:
        # On few samples noise makes all orders look alike.
        shown = harmonics(meter, many().every(HARMONICS_STRIDE), direction, point, settings)
        factors, needed = [n for prime, n in powers.items() if any(order % prime == 0 for order in shown)], np.inf
    else:
        # On a few samples it shows that nothing holds; that something does is to be seen on all.
        factors, needed = axis.against(few, arbitrary).promising(powers.values())
    if not arbitrary.is_round and not factors:
        return RotationalSymmetry(known, arbitrary.rms, needed)
    arbitrary = roundness(meter, samples, direction, point, settings)
    if arbitrary.is_round:
        return RotationalSymmetry(None, arbitrary.rms, 0.0)
    rotations = axis.against(samples, arbitrary)
    order, needed = _order(rotations, [p for p, n in powers.items() if n in factors], known, needed)
    return RotationalSymmetry(order, arbitrary.rms, needed)


def is_symmetric(
    meter: DeviationMeter,
    samples: SurfaceSamples,
    direction: FloatArray,
    point: FloatArray,
    order: int,
    *,
    limit: float,
    many: Callable[[], SurfaceSamples],
    settings: SearchSettings = DEFAULT,
) -> bool:
    """Whether rotations by an order hold, distinctly better than arbitrary ones unless the surface is round.

    Args:
        meter: what to measure with.
        samples: points on the surface.
        direction: of the axis, ``(3,)`` unit.
        point: on the axis ``(3,)``.
        order: of the axis.
        limit: it must hold within this RMS deviation.
        many: gives more samples, asked where the others do not tell it from noise.
        settings: the thresholds.
    """
    few = samples.every(_SCREEN_STRIDE)
    rough = _Axis(meter, direction, point, limit, False, None, settings)
    if rough.against(few, roundness(meter, few, direction, point, settings)).needed(order)[1] <= _CONTRAST:
        return True
    arbitrary = roundness(meter, samples, direction, point, settings)
    axis = _Axis(meter, direction, point, limit, False, many, settings)
    return arbitrary.is_round or axis.against(samples, arbitrary).needed(order)[0] <= limit


@dataclass(frozen=True, eq=False)
class _Axis:
    """An axis whose order is looked for, see `rotation_order`."""

    meter: DeviationMeter
    direction: FloatArray
    point: FloatArray
    limit: float
    past_facets: bool
    many: Callable[[], SurfaceSamples] | None
    settings: SearchSettings

    def against(self, samples: SurfaceSamples, arbitrary: Roundness) -> "_Rotations":
        """Its rotations seen on some samples, beside ``arbitrary`` ones."""
        allowed = np.zeros(len(samples))
        if self.past_facets:
            allowed = np.minimum(
                _FACET_SLACK * self.meter.facets.at(samples.owners), self.settings.round_deviation * arbitrary.radius
            )
        excess = _excess(arbitrary.deviations.squared, allowed, self.settings.truncation)
        reference = mean_where(excess, self.meter.telling(arbitrary.deviations))
        # Half a step of the order n moves no point farther than this share of the radius: more is not round enough.
        largest = np.pi * arbitrary.radius / max(arbitrary.rms, 1e-12)
        return _Rotations(self, samples, allowed, reference, largest)

    @cached_property
    def closely(self) -> "_Rotations | None":
        """Its rotations seen on many samples, if there are more."""
        if self.many is None:
            return None
        samples = self.many()
        arbitrary = roundness(self.meter, samples, self.direction, self.point, self.settings)
        return replace(self.against(samples, arbitrary), is_close=True)


@dataclass(frozen=True, slots=True, eq=False)
class _Rotations:
    """Rotations about an axis, seen on n ``samples``.

    ``allowed`` ``(n,)``: what is taken off deviations; ``reference`` ``(n,)``: squared ones of arbitrary angles;
    ``largest``: order that can be told; ``is_close``: the samples are as many as there are.
    """

    axis: _Axis
    samples: SurfaceSamples
    allowed: FloatArray
    reference: FloatArray
    largest: float
    is_close: bool = False

    def promising(self, orders: Iterable[int]) -> tuple[list[int], float]:
        """Those of some orders whose rotation is not far too bad, and the least RMS deviation that others may have."""
        orders = [n for n in orders if n <= max(self.largest, _ALWAYS)]
        if not orders or not self.reference.any():
            return [], np.inf
        angles = np.array([2.0 * np.pi * multiples(n)[0] / n for n in orders])
        limit = self.axis.limit
        deviations = self._measured(angles)
        there = np.where(deviations.missing, 0.0, deviations.squared)
        excess = _excess(there, self.allowed, self.axis.settings.truncation)
        errors, difference = excess.mean(1), self.reference - excess
        # Others are no better than arbitrary ones at any tolerance.
        better = difference.mean(1) > _SCREEN_SIGNIFICANCE * difference.std(1) / np.sqrt(excess.shape[1])
        good = better & (errors <= _SCREEN_FACTOR * limit**2)
        left = errors[better & ~good] / _SCREEN_FACTOR
        needed = float(np.sqrt(left.min(initial=np.inf)))
        return [n for n, kept in zip(orders, good.tolist(), strict=True) if kept], needed

    def needed(self, n: int, *, likely: bool = False) -> tuple[float, float]:
        """The RMS deviation within which the rotations of an order are symmetries; one above the limit if they are not.

        Infinite where they are not distinctly better than arbitrary ones. And how large their squared deviation is, as
        a share of that of arbitrary ones.
        """
        settings, largest, worst = self.axis.settings, 0.0, 0.0
        own, reference = np.zeros(len(self.samples)), np.zeros(len(self.samples))
        for angle in 2.0 * np.pi / n * multiples(n):  # the first tells most of those apart that do not hold
            deviations = self._measured(angle[None])
            largest = max(largest, float(deviations.rms[0]))
            if largest > self.axis.limit:
                return largest, 1.0
            seen = self.axis.meter.telling(deviations)[0]
            excess = np.where(seen, _excess(deviations.squared, self.allowed, settings.truncation)[0], 0.0)
            beside = np.where(seen, self.reference, 0.0)
            own, reference = own + excess, reference + beside
            worst = max(worst, float(excess.mean()) / max(float(beside.mean()), 1e-300))
            if worst > _CONTRAST and not might_explain_better(own, reference, settings, likely=likely):
                return np.inf, 1.0
        if worst <= _CONTRAST:
            return largest, worst
        closely = None if self.is_close else self.axis.closely
        if closely is not None:
            return closely.needed(n, likely=likely)
        if not explains_better(own, reference, settings, closely=self.is_close, likely=likely):
            return np.inf, 1.0
        return largest, float(own.mean()) / float(reference.mean())

    def _measured(self, angles: FloatArray) -> Deviations:
        return self.axis.meter.measure(Operations.rotations(self.axis.direction, self.axis.point, angles), self.samples)


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


def _order(rotations: _Rotations, primes: list[int], known: int, needed: float) -> tuple[int, float]:
    """The order of an axis: what is ``known`` times the prime powers that hold, of ``primes`` that may.

    Returns:
        the order, and the least RMS deviation within which another one may hold, at most ``needed``.
    """
    if not rotations.reference.any():
        return known, needed
    largest, limit = rotations.axis.settings.largest_order, rotations.axis.limit
    found: list[tuple[int, float]] = []
    for prime in primes:
        power, order = _next_power(prime, known), known
        while order * prime <= largest and power <= max(rotations.largest, _ALWAYS):
            # Twice the order of an axis is wrong by half a step, or right.
            rms, share = rotations.needed(power, likely=power > prime)
            if rms > limit:
                needed = min(needed, rms)
                break
            found.append((prime, share))
            order *= prime
            power *= prime
    shares = [share for _, share in found]
    if known > 1 and max(shares, default=0.0) > _CONTRAST:
        shares.append(rotations.needed(known)[1])
    least = min(shares, default=0.0)
    order = known
    for prime, share in found:
        if order * prime <= largest and share <= max(_CONTRAST, least + _AS_GOOD * (1.0 - least)):
            order *= prime
    return order, needed


def _next_power(prime: int, known: int) -> int:
    """The smallest power of a prime that does not divide an order."""
    power = prime
    while known % power == 0:
        power *= prime
    return power


def prime_rotations(direction: FloatArray, point: FloatArray) -> Operations:
    """A rotation for each of `PRIMES` about the axis through ``point`` ``(3,)`` along the unit ``direction``."""
    return Operations.rotations(direction, point, _prime_angles())


@lru_cache(maxsize=1)
def _prime_angles() -> FloatArray:
    return np.array([2.0 * np.pi * multiples(n)[0] / n for n in PRIMES.tolist()])


@lru_cache(maxsize=512)
def multiples(n: int) -> FloatArray:
    """Multiples of the smallest rotation that generate all of them and are far from it.

    Rotations by a small angle prove nothing: bumps and noise are moved by less than their size.
    """
    prime = [k for k in range(1, n) if np.gcd(k, n) == 1]
    return np.array(sorted({min(prime, key=lambda k: abs(k - share * n)) for share in _SHARES}), dtype=np.float64)
