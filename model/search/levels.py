"""Which level of the ladder people mean: the one that needs much more tolerance before anything else holds."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from model.geometry.operations import Operations
from model.search.axis_order import facet_tolerance, multiples
from model.search.comparison import explains_better, mean_where, might_explain_better
from model.search.context import SearchContext
from model.search.deviation import SurfaceSamples
from model.search.hypothesis import Hypothesis
from model.search.point_groups import ARBITRARY_ANGLES, CONTINUOUS, frame_of, point_group
from model.search.settings import SearchSettings
from model.types import FloatArray

_AS_TOLERANT = 1.02
"""Levels whose tolerances differ by less are one: the larger group stands for both."""

_SAME_ANGLE = float(np.deg2rad(4.0))
_PARALLEL = float(np.cos(_SAME_ANGLE))
_A_REFLECTION = 1e-6
"""Angle of a rotary reflection below which it is none."""


def choose(context: SearchContext, levels: Sequence[Hypothesis]) -> int:
    """The index of the level with the most room above it; finer ones win ties.

    The room above a level is how many times more tolerance the next one needs, above the last one the threshold. No
    level needs less than modelling precision, and noise, which is in all of them, counts for none. What holds at a
    tolerance holds all the more of a part of it: no level costs more than a later one.
    """
    least = context.settings.modelling_precision
    noise = levels[0].noise(context) if len(levels) > 1 and levels[0].rms > least else 0.0
    costs = [max(float(np.sqrt(max(level.rms**2 - noise**2, 0.0))), least) for level in levels]
    for index in range(len(costs) - 2, -1, -1):
        costs[index] = min(costs[index], costs[index + 1])
    best, most = len(levels) - 1, -np.inf
    for index, cost in enumerate(costs):
        last = index + 1 == len(costs)
        above = max(context.limit, cost) if last else costs[index + 1]
        if not last and above < _AS_TOLERANT * cost:
            continue
        room = float(np.log(above / cost))
        if room > most + 1e-9:
            best, most = index, room
    return best


def continuous_levels(context: SearchContext, direction: FloatArray, point: FloatArray) -> list[Hypothesis]:
    """The continuous groups about an axis that hold, each within the next: `Cinfv`, `Dinfh`, `Kh`."""
    levels: list[Hypothesis] = []
    centre = point + direction * (direction @ (context.centre - point))
    frame = frame_of(direction, direction)
    for name in CONTINUOUS:
        hypothesis = Hypothesis(point_group(name), frame, centre).measured(context).fitted(context, stride=4)
        if hypothesis.rms > context.limit or not hypothesis.is_believed(context.settings):
            break
        levels.append(hypothesis)
        frame, centre = hypothesis.frame, hypothesis.centre
    return levels


def facing_best_plane(
    level: Hypothesis, candidates: Operations, rms: FloatArray, settings: SearchSettings
) -> Hypothesis:
    """A group about a continuous axis, turned about it until its first plane is the best of those found through it.

    Which planes stand for all that pass through a continuous axis is a matter of choice: a head with a face is round,
    and exactly symmetric in one of them.

    Args:
        level: any group; others than these stay as they are.
        candidates: k operations that hold somehow.
        rms: deviations of these ``(k,)``.
        settings: what counts as the same.
    """
    if level.name not in ("Cinfv", "Dinfh"):
        return level
    mirrors = candidates.improper & (candidates.angles < _A_REFLECTION)
    along = np.abs(candidates.directions @ level.axis) < np.sin(settings.same_angle)
    through = mirrors & along & level.contains(candidates, settings.same_angle, settings.same_distance)
    if not through.any():
        return level
    best = np.flatnonzero(through)[np.argmin(rms[through])]
    return replace(level, frame=frame_of(level.axis, candidates.directions[best]))


def against_round(context: SearchContext, finite: Hypothesis, continuous: Hypothesis, *, likely: bool = False) -> bool:
    """Whether a finite group explains the shape distinctly better than the continuous one that it is a part of.

    Rotations by its orders about the continuous axes then fit, and arbitrary ones do not. Differences of the size of
    facets do not count: a cylinder drawn with many segments is meant to be round.

    Args:
        context: the shape.
        finite: the one group.
        continuous: the other.
        likely: a smaller group about the axis was found to explain it better.
    """
    directions = finite.directions
    orders = np.array(finite.group.orders, dtype=np.int64)
    about = np.ones(len(orders), dtype=np.bool_)
    if continuous.name != "Kh":
        about = np.abs(directions @ continuous.axis) > _PARALLEL
    if not about.any():
        return False
    settings = context.settings
    axis, order = directions[about][0], int(orders[about][0])
    angles = 2.0 * np.pi / order * multiples(order)
    own = Operations.rotations(axis, finite.centre, angles)
    arbitrary = Operations.rotations(axis, finite.centre, ARBITRARY_ANGLES)
    if continuous.name == "Kh":
        arbitrary = Operations.joined([arbitrary, continuous.generators])
    deviation = settings.sphere_deviation if continuous.name == "Kh" else settings.round_deviation
    cut = settings.truncation**2

    def compared(samples: SurfaceSamples) -> tuple[FloatArray, FloatArray]:
        radius = samples.radius_about(axis, finite.centre)
        facets = facet_tolerance(context.meter, samples, radius, deviation, settings)
        found, beside = context.meter.measure(own, samples), context.meter.measure(arbitrary, samples)
        telling, telling_beside = context.meter.telling(found), context.meter.telling(beside)
        both = telling.any(0) & telling_beside.any(0)
        squared = mean_where(np.minimum(found.squared, cut), telling)
        others = np.minimum(beside.squared, cut)
        others = mean_where(np.where(others <= np.square(facets), np.minimum(others, squared), others), telling_beside)
        return squared[both], others[both]

    squared, others = compared(context.judging)
    if explains_better(squared, others, settings):
        return True
    return might_explain_better(squared, others, settings, likely=likely) and explains_better(
        *compared(context.many), settings, closely=True, likely=likely
    )


def with_round(
    context: SearchContext, rungs: Sequence[Hypothesis], continuous: Sequence[Hypothesis]
) -> list[Hypothesis]:
    """Finite and continuous levels together, without those that another one explains away."""
    levels = list(continuous)
    while levels:
        turning = [rung for rung in rungs if _turns_about(rung, levels[-1])]
        if not turning and len(levels) < len(continuous):
            break  # it is no sphere, and the lines it is nearly round about are no axes of what it is
        distinct: list[Hypothesis] = []
        for rung in turning:
            if against_round(context, rung, levels[-1], likely=bool(distinct)):
                distinct.append(rung)
        rungs = [rung for rung in rungs if rung not in turning or rung in distinct]
        if not distinct:
            return [*rungs, *levels]
        levels = levels[:-1] if levels[-1].name == "Kh" else []
    return list(rungs)


def _turns_about(finite: Hypothesis, continuous: Hypothesis) -> bool:
    if continuous.name == "Kh":
        return len(finite.group.directions) > 0
    return bool((np.abs(finite.directions @ continuous.axis) > _PARALLEL).any())
