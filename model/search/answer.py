"""From the ladder of groups to the answer: one level's planes and axes with their errors, and what is left over."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from model.geometry.operations import Operations
from model.search.context import SearchContext
from model.search.deviation import SurfaceSamples
from model.search.exactness import ExactnessTest, Verdict
from model.search.full import Found
from model.search.hypothesis import Hypothesis
from model.search.levels import choose
from model.symmetries import Candidate, FoundAxis, FoundPlane, Level, Symmetries
from model.types import FloatArray

_ENOUGH_FLAT, _EVERY_WAY = 0.3, 0.01

_MANY, _FEWEST = 3, 200
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
    """A level with its frame settled: its elements' errors, coverage and largest deviations, and what breaks it."""

    level: Hypothesis
    errors: FloatArray
    coverage: FloatArray
    largest: FloatArray
    verdict: Verdict


def answer(
    context: SearchContext, found: Found, samples: SurfaceSamples, test: ExactnessTest, choice: LevelChoice
) -> Symmetries:
    """The symmetries of a shape, unit frame.

    Args:
        context: the shape.
        found: its levels and candidates.
        samples: of the surface, that took no part in finding them.
        test: of what is exact.
        choice: of the level.
    """
    levels = list(found.levels)
    judged: _Judged | None = None
    index: int | None = None
    while levels and judged is None:
        index, judged = _chosen(context, levels, samples, test, choice)
        if index is None:
            break
        if judged is not None and np.sqrt(judged.errors.max(initial=0.0)) > context.limit:
            del levels[index]  # other samples than those it was found on say otherwise
            index, judged = None, None
    result = Symmetries(levels=[_level(level) for level in levels], chosen=index)
    if judged is not None and index is not None:
        _add_elements(judged, result)
        result.levels[index] = _level(judged.level, exact=judged.verdict.exact, breaks=tuple(judged.verdict.patches()))
    _add_others(context, judged.level if judged else None, found, result)
    return result


def _chosen(
    context: SearchContext,
    levels: list[Hypothesis],
    samples: SurfaceSamples,
    test: ExactnessTest,
    choice: LevelChoice,
) -> tuple[int | None, _Judged | None]:
    if choice.tolerance is not None:
        within = [k for k, level in enumerate(levels) if level.rms <= choice.tolerance]
        return (within[-1], _judge(context, levels[within[-1]], samples, test)) if within else (None, None)
    if choice.kind == "exact":
        for index in reversed(range(len(levels))):
            judged = _judge(context, levels[index], samples, test)
            if judged.verdict.exact:
                return index, judged
        return None, None
    index = choose(context, levels)
    return index, _judge(context, levels[index], samples, test)


def _judge(context: SearchContext, level: Hypothesis, samples: SurfaceSamples, test: ExactnessTest) -> _Judged:
    level = level.fitted(context, stride=1, steps=20).settled(context, _telling_points(context))
    members = level.elements
    if not len(members):
        members = level.generators  # an inversion has no element that could be listed
    stride = max(1, min(len(samples) // _FEWEST, -(-len(members) // _MANY)))
    deviations = context.meter.measure(members, samples.every(stride))
    largest = np.sqrt(np.where(deviations.missing, 0.0, deviations.squared).max(1))
    coverage = deviations.coverage(context.settings.fit_distance)
    return _Judged(level, np.square(deviations.rms), coverage, largest, test.exact(level))


def _telling_points(context: SearchContext) -> FloatArray:
    """What the frame is settled on: samples of flat faces, if there are enough looking every way, else all.

    Facets of a curved surface are drawn anywhere along it; flat faces are where they are meant to be.
    """
    samples = context.samples
    flat = context.meter.facets.is_flat(samples.owners)
    normals = samples.normals[flat]
    every_way = len(normals) > 0 and float(np.linalg.eigvalsh(normals.T @ normals)[0]) > _EVERY_WAY * len(normals)
    return samples.points[flat] if every_way and flat.mean() >= _ENOUGH_FLAT else context.points(1)


def _add_elements(judged: _Judged, result: Symmetries) -> None:
    level = judged.level
    result.point_group = level.name
    members, orders = level.elements, level.group.orders
    largest, fits = judged.verdict.of(members)
    planes, family = len(level.planes), 0 in orders
    for k in range(len(members)):
        error, coverage = float(judged.errors[k]), float(judged.coverage[k])
        exact, distance = bool(fits[k]), float(max(largest[k], judged.largest[k]))
        if k < planes:
            continuous = family and (level.name == "Kh" or k < 2)
            result.planes.append(FoundPlane(level.planes[k], error, continuous, coverage, exact, distance))
        else:
            order = orders[k - planes] or None
            result.axes.append(FoundAxis(members.directions[k], level.centre, order, error, coverage, exact, distance))


def _level(level: Hypothesis, **judged: object) -> Level:
    counts = len(level.group.normals), len(level.group.directions)
    return Level(level.name, level.rms, level.missing, *counts, **judged)  # pyright: ignore[reportArgumentType]


def _add_others(context: SearchContext, level: Hypothesis | None, found: Found, result: Symmetries) -> None:
    """Candidates that belong to no group of the answer: similar within the threshold, or rejected."""
    settings = context.settings
    for index in range(len(found.rms)):
        operation = found.candidates[[index]]
        if level is not None and level.contains(operation, 2.0 * settings.same_angle, 2.0 * settings.same_distance):
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
