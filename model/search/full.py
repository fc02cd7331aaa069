"""Full mode: every symmetry of a shape, as groups that hold as a whole.

The paper stops at three approximate planes (section 5) and names the rest as open. Here the network's output is one
source of candidates among others; what decides is geometry. In order: lines about which the shape may be round;
candidates for planes and half turns, refined; the ladder of groups that they build; the level that is answered with.
"""

from dataclasses import dataclass

import numpy as np

from model.geometry.operations import Operations
from model.geometry.refinement import refine
from model.geometry.scan import directions, minima
from model.network.output import NetworkOutput
from model.search.axis_order import roundness
from model.search.candidates import RefinedCandidates, fits_whole, refine_and_deduplicate
from model.search.context import SearchContext
from model.search.hypothesis import Hypothesis
from model.search.ladder import Ladder
from model.search.levels import continuous_levels, with_round
from model.search.lines import distinct_lines
from model.search.point_groups import ARBITRARY_ANGLES
from model.types import FloatArray

_MOST_THROUGH_ROUND = 3
_DIRECTION_STRIDE = 5
_ALONG = float(np.sin(np.deg2rad(8.0)))

_ONE_SIDED = 0.25
"""Length of the mean normal of an open surface, above which only one side of it may have been seen."""


@dataclass(frozen=True, slots=True)
class Sources:
    """Where the candidates come from: for ablations."""

    network: bool = True
    inertia: bool = True
    scan: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """The ``levels`` of a shape, each a group that holds, the finest first.

    ``candidates`` with their RMS deviations ``rms``, and those ``dropped`` early with an SDE on few samples.
    """

    levels: list[Hypothesis]
    candidates: Operations
    rms: FloatArray
    dropped: Operations
    dropped_errors: FloatArray


def find_symmetries(context: SearchContext, network: NetworkOutput | None, sources: Sources) -> Found:
    """All symmetry groups of a shape in the unit frame, and the candidates they were built from.

    Args:
        context: what to search.
        network: what the network says, asked where ``sources`` says so.
        sources: of candidates.
    """
    holed = not context.meter.closed and not _is_whole(context, sources)
    lines = _lines(context, network, sources, holed)
    nearly_round: list[tuple[FloatArray, FloatArray]] = []
    for line in lines:
        direction, point, exact, rough = _roundness(context, line)
        if exact:
            levels = continuous_levels(context, direction, point)
            if levels:
                return _found(levels)
        if rough:
            nearly_round.append((direction, point))
    starts = _starts(context, network, sources, [direction for direction, _ in nearly_round], holed)
    refined = refine_and_deduplicate(context, starts, _starts_beside(context, sources) if holed else None)
    ladder = Ladder(context, lines, holed=holed)
    ladder.climb(refined.operations, refined.costs)
    ladder.extend_roughly()
    continuous: list[Hypothesis] = []
    for direction, point in [*nearly_round, *ladder.round_lines]:
        continuous = continuous_levels(context, direction, point)
        if continuous:
            break
    return _found(with_round(context, ladder.rungs, continuous), refined)


def _found(
    levels: list[Hypothesis],
    refined: RefinedCandidates | None = None,
) -> Found:
    distinct = [level for k, level in enumerate(levels) if all(level.name != other.name for other in levels[k + 1 :])]
    if refined is None:
        empty = Operations.reflections(np.zeros((0, 4)))
        return Found(distinct, empty, np.zeros(0), empty, np.zeros(0))
    return Found(distinct, refined.operations, refined.rms, refined.dropped, refined.dropped_errors)


def _is_whole(context: SearchContext, sources: Sources) -> bool:
    """Whether an open surface is as somebody drew it: rims that nobody tore, and a symmetry of all that is there.

    A part that was missing would leave a ragged rim, and hardly ever a symmetry without it. Then nothing is looked for
    that only what is missing could hide.
    """
    if not sources.scan or context.meter.is_torn or context.meter.one_sidedness > _ONE_SIDED:
        return False
    return fits_whole(context, _starts(context, None, sources, [], holed=False))


def _starts_from_network(sources: Sources, holed: bool) -> bool:
    """Whether the network's answers may change what is found: where nothing is missing the other two find all it would.

    Then it is not waited for, unless something inexact is to be judged.
    """
    return sources.network and (holed or not (sources.inertia and sources.scan))


def _lines(context: SearchContext, network: NetworkOutput | None, sources: Sources, holed: bool) -> FloatArray:
    """Directions through the centre that may be axes of high order: ``(k, 3)``, each once."""
    candidates = [np.zeros((0, 3))]
    if sources.inertia:
        candidates.append(context.principal)
    if network is not None and _starts_from_network(sources, holed):
        candidates.append(network.first.directions)
    return distinct_lines(np.concatenate(candidates))


def _roundness(context: SearchContext, line: FloatArray) -> tuple[FloatArray, FloatArray, bool, bool]:
    """An axis near ``line``, refined; whether the shape is round about it up to its facets, or at least roughly."""
    rotated = Operations.rotations(line, context.centre, ARBITRARY_ANGLES)
    promising = context.settings.promising_axis
    if context.scores(rotated, promising).max() > promising:
        return line, context.centre, False, False
    axis = refine(context.surface, context.points(3), rotated[:1], 8, scale=0.05)
    direction, point = axis.directions[0], axis.points[0]
    found = roundness(context.meter, context.samples.every(2), direction, point, context.settings)
    return direction, point, found.is_round, found.rms <= context.limit


def _starts(
    context: SearchContext,
    network: NetworkOutput | None,
    sources: Sources,
    round_lines: list[FloatArray],
    holed: bool,
) -> Operations:
    settings = context.settings
    normals: list[FloatArray] = [np.zeros((0, 3))]
    halves: list[FloatArray] = [np.zeros((0, 3))]
    if sources.inertia:
        normals.append(context.principal)
    if sources.scan:
        promising = settings.promising_holed if holed else settings.promising_plane
        mirrored, turned = context.grid.scan(promising, settings.promising_axis)
        scanned = minima(mirrored, settings.most_planes, promising) @ context.rotation
        if len(round_lines) > 1:  # nearly a sphere: the scan sees nothing
            scanned = directions()[::_DIRECTION_STRIDE]
        if len(round_lines) == 1:  # about a nearly round axis all planes look alike to the scan: a few are enough
            through = np.abs(scanned @ round_lines[0]) < _ALONG
            scanned = np.concatenate([scanned[through][:_MOST_THROUGH_ROUND], scanned[~through]])
        normals.append(scanned)
        halves.append(minima(turned, settings.most_axes, settings.promising_axis) @ context.rotation)
    rows = np.concatenate(normals)
    planes = np.column_stack([rows, -rows @ context.centre])
    if network is not None and _starts_from_network(sources, holed):
        # What is missing tilts the inertia frame and hides planes from the scan: other views see more.
        proposals = network.every if holed else network.first
        planes = np.concatenate([proposals.planes, planes])
    turns = Operations.rotations(np.concatenate(halves), context.centre, np.pi)
    return Operations.joined([Operations.reflections(planes), turns])


def _starts_beside(context: SearchContext, sources: Sources) -> Operations:
    """Planes that do not pass through the centre of what is there, where something is missing."""
    shifted = context.shifted_planes() if sources.scan else np.zeros((0, 4))
    return Operations.reflections(shifted)
