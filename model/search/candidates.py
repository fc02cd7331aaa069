"""From rough guesses to refined candidates: many starts in, few distinct symmetry operations out.

Cheap rejection comes first (few samples, few steps), precision last, for what is left.
"""

from dataclasses import dataclass

import numpy as np

from model.geometry.operations import Operations
from model.geometry.refinement import refine, squared_distances
from model.geometry.surface import SurfaceIndex
from model.search.context import SearchContext
from model.search.settings import DEFAULT
from model.types import FloatArray

_SAME_ANGLE, _SAME_DISTANCE = DEFAULT.same_angle, DEFAULT.same_distance

_BASIN_ANGLE = float(np.deg2rad(5.0))
_MUCH_BETTER = 10.0
"""An element so near to one that is so many times better has not come to rest: robust steps may stick where some faces
fit exactly and the others count as missing."""

_COARSE_STRIDE, _FINE_STRIDE = 6, 2
_MOST_CANDIDATES = 24
_HOPELESS, _POOR = 2.0, 1.1
"""Candidates whose truncated error exceeds the threshold so many times after the first and second round are dropped."""


@dataclass(frozen=True, slots=True, eq=False)
class RefinedCandidates:
    """Refined distinct ``operations``, sorted by error, and the starts ``dropped``.

    ``dropped_errors`` ``(k,)``: the SDE on few samples that each had when it was dropped.
    """

    operations: Operations
    dropped: Operations
    dropped_errors: FloatArray


def refine_and_deduplicate(context: SearchContext, starts: Operations) -> RefinedCandidates:
    """Refine ``starts`` on the exact distance and keep the good ones, each once."""
    surface, samples, max_error = context.surface, context.samples.points, context.max_error
    coarse = context.points(_COARSE_STRIDE)
    dropped: list[Operations] = []
    dropped_errors: list[FloatArray] = []
    operations, cut = starts, context.settings.truncation**2
    for steps, scale, bound in ((3, 0.15, _HOPELESS), (3, 0.04, _POOR)):
        operations = refine(surface, coarse, operations, steps, scale=scale, step_tolerance=1e-5)
        squared = squared_distances(surface, samples[::_COARSE_STRIDE], operations)
        errors = np.minimum(squared, cut).mean(1)
        good = errors <= bound * max_error
        dropped.append(operations[~good])
        dropped_errors.append(squared[~good].mean(1))
        operations, errors = operations[good], errors[good]
        kept = distinct(operations, errors)[:_MOST_CANDIDATES]
        operations = operations[kept]
    if len(operations):
        operations = refine(surface, context.points(_FINE_STRIDE), operations, 8, scale=0.02)
        squared = np.minimum(squared_distances(surface, samples, operations), cut)
        operations = operations[distinct(operations, squared.mean(1))]
    return RefinedCandidates(operations, Operations.joined(dropped), np.concatenate(dropped_errors))


def mean_errors(surface: SurfaceIndex, samples: FloatArray, operations: Operations) -> FloatArray:
    """The SDE of each operation on ``samples``: ``(k,)``."""
    return squared_distances(surface, samples, operations).mean(1)


def distinct(operations: Operations, errors: FloatArray) -> list[int]:
    """Indices, the best first, of operations that differ from every better one of their kind."""
    kept: list[int] = []
    for index in np.argsort(errors, kind="stable").tolist():
        for other in kept:
            unsettled = errors[index] > _MUCH_BETTER * errors[other]
            if same_element(operations, index, other, _BASIN_ANGLE if unsettled else _SAME_ANGLE):
                break
        else:
            kept.append(index)
    return kept


def same_element(operations: Operations, first: int, second: int, angle: float = _SAME_ANGLE) -> bool:
    """Whether two operations of a batch are the same one: kind, direction (to an angle) and position."""
    if operations.improper[first] != operations.improper[second]:
        return False
    if abs(operations.angles[first] - operations.angles[second]) > _SAME_ANGLE:
        return False
    gap = operations.points[first] - operations.points[second]
    if operations.improper[first] and operations.angles[first] > 3.0:  # inversions have no direction
        return float(np.linalg.norm(gap)) < _SAME_DISTANCE
    direction, other = operations.directions[first], operations.directions[second]
    if abs(direction @ other) < np.cos(angle):
        return False
    if operations.improper[first]:  # planes: compared by offset
        sign = 1.0 if direction @ other > 0 else -1.0
        return abs(direction @ operations.points[first] - sign * other @ operations.points[second]) < _SAME_DISTANCE
    return float(np.linalg.norm(gap - (gap @ direction) * direction)) < _SAME_DISTANCE
