"""From the ladder of groups to the answer: one level's planes and axes with their errors, and what is left over."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from model.geometry.operations import Operations
from model.network.output import NetworkOutput
from model.search.confidence import confidence
from model.search.context import SearchContext
from model.search.deviation import SurfaceSamples
from model.search.exactness import ExactnessTest, Verdict
from model.search.full import Found
from model.search.hypothesis import Hypothesis
from model.search.levels import choose, facing_best_plane
from model.search.prediction import guesses, likeliest
from model.search.subgroup import exact_part
from model.symmetries import Candidate, EvidenceKind, FoundAxis, FoundPlane, Level, Symmetries
from model.types import FloatArray

_ENOUGH_FLAT, _EVERY_WAY = 0.3, 0.01

_COMPARED = 2
_MANY, _FEWEST = 2, 200
"""Beyond so many elements each is measured on fewer samples, the group being its own proof, but on so many at least."""


@dataclass(frozen=True, slots=True)
class LevelChoice:
    """Which level is answered with.

    ``kind``: ``auto``, the one with the most room above it; ``exact``, the largest that is exact. ``tolerance``: the
    largest that holds within this RMS deviation, unit frame; it comes before ``kind``.
    """

    kind: Literal["auto", "exact"] = "auto"
    tolerance: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Judged:
    """A level's elements' errors, coverage and largest deviations, and what breaks it; None of what is predicted."""

    errors: FloatArray
    coverage: FloatArray
    largest: FloatArray
    verdict: Verdict | None

    @property
    def exact(self) -> bool:
        """Whether the level holds everywhere, up to what the file promises."""
        return self.verdict is not None and self.verdict.exact


def answer(
    context: SearchContext,
    found: Found,
    samples: SurfaceSamples,
    test: ExactnessTest,
    choice: LevelChoice,
    network: NetworkOutput | None,
) -> Symmetries:
    """The symmetries of a shape, unit frame.

    Args:
        context: the shape.
        found: its levels and candidates.
        samples: of the surface, that took no part in finding them.
        test: of what is exact.
        choice: of the level.
        network: what the network says, None if it is not to be asked.
    """
    levels = [facing_best_plane(level, found.candidates, found.rms, context.settings) for level in found.levels]
    ladder = _JudgedLadder(context, levels, samples, test, network)
    chosen = ladder.chosen(choice)
    result = Symmetries()
    for index, rung in enumerate(ladder.rungs):
        result.levels.append(_level(rung))
        if rung is chosen:
            result.chosen = index
            _add_elements(rung, ladder.confidence_of(rung.level), result)
    _add_others(context, None if chosen is None else chosen.level, found, result)
    return result


@dataclass(slots=True, eq=False)
class _Rung:
    """A level, and the probability that it is one of the intact shape.

    ``settled``: its frame is final. ``judged``: what judging it found, if it was judged. ``evidence``: what it rests
    on.
    """

    level: Hypothesis
    confidence: float
    settled: bool = False
    judged: _Judged | None = None
    evidence: EvidenceKind = "measured"


class _JudgedLadder:
    """The levels of a shape, each judged when it is asked for."""

    def __init__(
        self,
        context: SearchContext,
        levels: Sequence[Hypothesis],
        samples: SurfaceSamples,
        test: ExactnessTest,
        network: NetworkOutput | None,
    ) -> None:
        self._context, self._samples, self._test, self._network = context, samples, test, network
        # One alone is certain to be judged; of several, one is chosen before.
        self.rungs = [self._rung(level, settled=len(levels) == 1) for level in levels]

    def chosen(self, choice: LevelChoice) -> _Rung | None:
        """The level to answer with, judged; None if there is none."""
        if choice.kind == "exact" and choice.tolerance is None:
            return self._largest_exact()
        while True:
            rung = self._best(choice)
            if rung is None:
                return self._predicted() if choice.tolerance is None else None
            if self._judged(rung).errors.max(initial=0.0) <= self._context.max_error:
                self._add_exact_part(rung)
                return rung
            self.rungs.remove(rung)  # other samples than those it was found on say otherwise

    def confidence_of(self, level: Hypothesis) -> FloatArray:
        """Of the planes and axes of a level: that of the surest level that each belongs to, ``(k,)``."""
        settings, members = self._context.settings, level.elements
        result = np.zeros(len(members))
        for rung in self.rungs:
            belongs = rung.level.contains(members, settings.same_angle, settings.same_distance)
            result = np.where(belongs, np.maximum(result, rung.confidence), result)
        return result

    def _best(self, choice: LevelChoice) -> _Rung | None:
        if choice.tolerance is not None:
            return next((rung for rung in reversed(self.rungs) if rung.level.rms <= choice.tolerance), None)
        believed = [rung for rung in self.rungs if rung.confidence >= self._context.settings.least_confidence]
        return believed[choose(self._context, [rung.level for rung in believed])] if believed else None

    def _predicted(self) -> _Rung | None:
        """What the network sees of an open surface, where no level found is believed; None where it is not sure."""
        context = self._context
        if self._network is None or context.meter.closed or context.is_spent:
            return None
        best = likeliest(guesses(context, self._network))
        if best is None or best[1] < context.settings.least_confidence:
            return None
        level = self._measured(best[0])
        # What the surface alone bears out is measured, whoever thought of it.
        seen = level.is_believed(context.settings) and (
            confidence(context, level, self._network) >= context.settings.least_confidence
        )
        judged = self._judge(level, measured=seen)
        if level.rms > context.limit or judged.errors.max() > context.max_error:
            return None
        rung = _Rung(level, best[1], settled=True, judged=judged, evidence="measured" if seen else "predicted")
        finer = sum(other.level.rms <= level.rms for other in self.rungs)
        self.rungs.insert(finer if seen else len(self.rungs), rung)
        return rung

    def _largest_exact(self) -> _Rung | None:
        for rung in reversed(self.rungs):
            if self._judged(rung).exact:
                return rung
        return self._add_exact_part(self.rungs[0]) if self.rungs else None

    def _add_exact_part(self, rung: _Rung) -> _Rung | None:
        """Put what is exact of a level that is not before it, unless a level says so already."""
        verdict = self._judged(rung).verdict
        part = None if verdict is None else exact_part(verdict)
        index = self.rungs.index(rung)
        if part is None or any(part.name == other.level.name for other in self.rungs[:index]):
            return None
        added = self._rung(part.measured(self._context))
        if not self._judged(added).exact:
            return None
        self.rungs.insert(index, added)
        return added

    def _rung(self, level: Hypothesis, *, settled: bool = False) -> _Rung:
        level = self._settled(level) if settled else self._measured(level)
        return _Rung(level, confidence(self._context, level, self._network), settled)

    def _settled(self, level: Hypothesis) -> Hypothesis:
        context = self._context
        fitted = level.fitted(context, stride=1, steps=20)
        return self._measured(fitted.settled(context, _telling_points(context), self._test.allowed))

    def _measured(self, level: Hypothesis) -> Hypothesis:
        """What few samples said of a small feature was chance; which level is answered with must not be."""
        return level.measured(self._context, thoroughly=True, samples=self._samples.every(_COMPARED))

    def _judged(self, rung: _Rung) -> _Judged:
        if rung.judged is None:
            rung.level = rung.level if rung.settled else self._settled(rung.level)
            rung.settled, rung.judged = True, self._judge(rung.level)
        return rung.judged

    def _judge(self, level: Hypothesis, *, measured: bool = True) -> _Judged:
        context, samples = self._context, self._samples
        members = level.elements
        if not len(members):
            members = level.generators  # an inversion has no element that could be listed
        stride = max(1, min(len(samples) // _FEWEST, -(-len(members) // _MANY)))
        deviations = context.meter.measure(members, samples.every(stride))
        largest = np.sqrt(np.where(deviations.missing, 0.0, deviations.squared).max(1))
        coverage = deviations.coverage(context.settings.fit_distance)
        return _Judged(np.square(deviations.rms), coverage, largest, self._test.exact(level) if measured else None)


def _telling_points(context: SearchContext) -> FloatArray:
    """What the frame is settled on: samples of flat faces, if there are enough looking every way, else all.

    Facets of a curved surface are drawn anywhere along it; flat faces are where they are meant to be.
    """
    samples = context.samples
    flat = context.meter.facets.is_flat(samples.owners)
    normals = samples.normals[flat]
    every_way = len(normals) > 0 and float(np.linalg.eigvalsh(normals.T @ normals)[0]) > _EVERY_WAY * len(normals)
    return samples.points[flat] if every_way and flat.mean() >= _ENOUGH_FLAT else context.points(1)


def _add_elements(rung: _Rung, confidence: FloatArray, result: Symmetries) -> None:
    level, judged = rung.level, rung.judged
    if judged is None:
        return
    result.point_group = level.name
    members, orders = level.elements, level.group.orders
    largest, fits = judged.largest, np.zeros(len(members), dtype=np.bool_)
    if judged.verdict is not None:
        largest, fits = judged.verdict.of(members)
    planes, family = len(level.planes), 0 in orders
    for k in range(len(members)):
        error, coverage = float(judged.errors[k]), float(judged.coverage[k])
        exact, distance = bool(fits[k]), float(max(largest[k], judged.largest[k]))
        shared = coverage, exact, distance, float(confidence[k]), rung.evidence
        if k < planes:
            continuous = family and (level.name == "Kh" or k < 2)
            result.planes.append(FoundPlane(level.planes[k], error, continuous, *shared))
        else:
            order = orders[k - planes] or None
            result.axes.append(FoundAxis(members.directions[k], level.centre, order, error, *shared))


def _level(rung: _Rung) -> Level:
    level, judged = rung.level, rung.judged
    return Level(
        level.name,
        level.rms,
        level.missing,
        len(level.group.normals),
        len(level.group.directions),
        None if judged is None else judged.exact,
        () if judged is None or judged.verdict is None else tuple(judged.verdict.patches()),
        rung.confidence,
        rung.evidence,
    )


def _add_others(context: SearchContext, level: Hypothesis | None, found: Found, result: Symmetries) -> None:
    """Candidates that belong to no group of the answer: similar within the threshold, or rejected."""
    settings = context.settings
    for index in range(len(found.rms)):
        operation = found.candidates[[index]]
        same = 2.0 * settings.same_angle, 2.0 * settings.same_distance
        if level is not None and level.contains(operation, *same)[0]:
            continue
        error = float(found.rms[index]) ** 2
        holds = error <= context.max_error
        (result.similar if holds else result.rejected).append(
            _candidate(operation, error, None if holds else "not_symmetric")
        )
    for index, error in enumerate(found.dropped_errors.tolist()):
        result.rejected.append(_candidate(found.dropped[[index]], error, "not_symmetric"))


def _candidate(operation: Operations, error: float, reason: Literal["not_symmetric"] | None) -> Candidate:
    if operation.improper[0]:
        return Candidate(error, reason, operation.planes[0])
    return Candidate(error, reason, direction=operation.directions[0], point=operation.points[0])
