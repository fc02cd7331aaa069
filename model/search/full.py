"""Full mode: every symmetry of a shape, refined, completed to a group, judged on samples that refined nothing.

The paper stops at three approximate planes (section 5) and names the rest as open. Here the network's output is one
source of starts among others; what decides is geometry. In order: surfaces of revolution; planes; the group that they
generate; orders about its axes; two-fold axes and improper operations still missing; judgement.
"""

from dataclasses import dataclass

import numpy as np

from model.geometry.operations import Operations
from model.geometry.refinement import refine
from model.geometry.scan import directions, minima
from model.network.proposals import Proposals
from model.search.axis_order import ARBITRARY_ANGLES, Turns, allowed_turns
from model.search.candidates import settle
from model.search.group_completion import Completion
from model.search.judgement import EXACT_ERROR
from model.search.revolution import revolution
from model.search.shape import PROMISING_AXIS, PROMISING_PLANE, Shape
from model.symmetries import Symmetries, TurnedDown
from model.types import FloatArray

_MOST_PLANES, _MOST_CANDIDATES = 14, 24
_MOST_THROUGH_ROUND = 3
_CLOSE = 1.5
"""Candidates beyond the threshold by no more than this go on to the verdict: refinement measures on few samples."""

_EVERY_DIRECTION = 5
_ALONG = float(np.sin(np.deg2rad(8.0)))


@dataclass(frozen=True, slots=True)
class Sources:
    """Where the starts come from: for ablations."""

    network: bool = True
    inertia: bool = True
    scan: bool = True


def find_symmetries(shape: Shape, proposals: Proposals | None, sources: Sources) -> Symmetries:
    """All planes and axes of a shape in the unit frame.

    Args:
        shape: what to search.
        proposals: the network's output, used where ``sources`` says so.
        sources: of starts.
    """
    lines = _lines(shape, proposals, sources)
    round_lines: list[FloatArray] = []
    roughly: list[FloatArray] = []
    for direction in lines:
        point, turns = _inspect(shape, direction)
        if turns.order is None and turns.exact:
            return revolution(shape, point[:3], point[3:])
        if turns.order is None:
            roughly.append(point)
        if turns.round_within:
            round_lines.append(point[:3])
    starts = _plane_starts(shape, proposals, sources, round_lines)
    planes = settle(shape.surface, shape.points, shape.samples, starts, shape.max_error)
    found, errors = planes.operations, planes.errors
    # Sorted: the first of them are the best.
    within = errors <= _CLOSE * shape.max_error
    rejected = [
        TurnedDown(error, "not_symmetric", plane)
        for part, part_errors in ((planes.dropped, planes.dropped_errors), (found[~within], errors[~within]))
        for plane, error in zip(part.planes, part_errors.tolist(), strict=True)
    ]
    completion = Completion(
        shape, lines, sources.scan, found[within][:_MOST_CANDIDATES], errors[within][:_MOST_CANDIDATES], rejected
    )
    exact = completion.exact()
    if roughly and not exact:  # a vase as scanned; what is exact would say more
        return revolution(shape, roughly[0][:3], roughly[0][3:])
    return completion.result()


def _lines(shape: Shape, proposals: Proposals | None, sources: Sources) -> FloatArray:
    """Directions through the centre that may be axes of high order: ``(k, 3)``, each once."""
    candidates = [shape.principal] if sources.inertia else []
    if sources.network and proposals is not None:
        candidates.append(proposals.directions)
    kept: list[FloatArray] = []
    for direction in np.concatenate([np.zeros((0, 3)), *candidates]):
        if not any(abs(direction @ other) > np.cos(np.deg2rad(5.0)) for other in kept):
            kept.append(direction)
    return np.reshape(kept, (-1, 3))


def _inspect(shape: Shape, direction: FloatArray) -> tuple[FloatArray, Turns]:
    """Whether the shape is round about an axis near ``direction``: the refined axis ``(6,)`` and what it allows."""
    start = np.concatenate([direction, shape.centre])
    count = len(ARBITRARY_ANGLES)
    turned = Operations.rotations(np.tile(direction, (count, 1)), shape.centre, ARBITRARY_ANGLES)
    if shape.scores(turned).max() > PROMISING_AXIS:
        return start, Turns(1, False)
    axis = refine(shape.surface, shape.points(3), turned[:1], 8, scale=0.05)
    point, few = np.concatenate([axis.directions[0], axis.points[0]]), shape.samples[::2]
    turns = allowed_turns(shape.surface, few, point[:3], point[3:], limit=EXACT_ERROR, max_error=shape.max_error)
    return point, turns


def _plane_starts(
    shape: Shape, proposals: Proposals | None, sources: Sources, round_lines: list[FloatArray]
) -> Operations:
    normals: list[FloatArray] = [np.zeros((0, 3))]
    if sources.inertia:
        normals.append(shape.principal)
    if sources.scan:
        mirrored, _ = shape.grid.scan
        scanned = minima(mirrored, _MOST_PLANES, PROMISING_PLANE) @ shape.turn
        if len(round_lines) > 1:  # nearly a sphere: the scan sees nothing
            scanned = directions()[::_EVERY_DIRECTION]
        if len(round_lines) == 1:  # about a nearly round axis all planes look alike to the scan: a few are enough
            through = np.abs(scanned @ round_lines[0]) < _ALONG
            scanned = np.concatenate([scanned[through][:_MOST_THROUGH_ROUND], scanned[~through]])
        normals.append(scanned)
    rows = np.concatenate(normals)
    starts = np.column_stack([rows, -rows @ shape.centre])
    if sources.network and proposals is not None:
        starts = np.concatenate([proposals.planes, starts])
    return Operations.reflections(starts)
