"""From rough guesses to refined candidates: many starts in, few distinct symmetry operations out.

Cheap rejection comes first (few samples, few steps), precision last, for what is left.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from model.geometry.operations import Operations
from model.geometry.refinement import refine, squared_distances
from model.geometry.surface import SurfaceIndex
from model.types import FloatArray

SAME_ANGLE = float(np.deg2rad(1.5))
SAME_DISTANCE = 0.015
"""Two elements of the same kind within this angle and distance (unit frame) are one."""

_BASIN_ANGLE = float(np.deg2rad(5.0))
_MUCH_BETTER = 10.0
"""An element so near to one that is so many times better has not come to rest: robust steps may stick where some faces
fit exactly and the others count as missing."""

_COARSE_EVERY, _FINE_EVERY = 6, 2
CUT = 0.06
"""Distances count up to here while candidates are sifted: a hole in the surface must not hide a symmetry."""

_HOPELESS, _POOR = 4.0, 1.3
"""Candidates whose cut error exceeds the threshold so many times after the first and second round are dropped."""


@dataclass(frozen=True, slots=True)
class Settled:
    """Refined distinct ``operations``, their ``errors`` (SDE on the refinement's samples), and the starts ``dropped``.

    Sorted by error; ``dropped`` with the SDE on few samples that each had when it was dropped.
    """

    operations: Operations
    errors: FloatArray
    dropped: Operations
    dropped_errors: FloatArray


def settle(
    surface: SurfaceIndex,
    points: Callable[[int], FloatArray],
    samples: FloatArray,
    starts: Operations,
    max_error: float,
) -> Settled:
    """Refine ``starts`` and keep the good ones, each once.

    Args:
        surface: the shape, unit frame.
        points: gives points of it to refine on, ``(m, 3)``, with every so many-th sample among them.
        samples: ``(n, 3)`` points to measure on.
        starts: what to begin with.
        max_error: threshold on the SDE.
    """
    coarse = points(_COARSE_EVERY)
    dropped: list[Operations] = []
    dropped_errors: list[FloatArray] = []
    operations = starts
    errors = np.zeros(len(operations))
    for steps, scale, bound in ((3, 0.15, _HOPELESS), (3, 0.04, _POOR)):
        operations = refine(surface, coarse, operations, steps, scale=scale, settled=1e-5)
        squared = squared_distances(surface, samples[::_COARSE_EVERY], operations)
        errors = np.minimum(squared, CUT * CUT).mean(1)
        good = errors <= bound * max_error
        dropped.append(operations[~good])
        dropped_errors.append(squared[~good].mean(1))
        operations, errors = operations[good], errors[good]
        kept = distinct(operations, errors)
        operations, errors = operations[kept], errors[kept]
    if len(operations):
        operations = refine(surface, points(_FINE_EVERY), operations, 8, scale=0.02)
        errors = mean_errors(surface, samples, operations)
        kept = distinct(operations, errors)
        operations, errors = operations[kept], errors[kept]
    return Settled(operations, errors, Operations.joined(dropped), np.concatenate(dropped_errors))


def mean_errors(surface: SurfaceIndex, samples: FloatArray, operations: Operations) -> FloatArray:
    """The SDE of each operation on ``samples``: ``(k,)``."""
    return squared_distances(surface, samples, operations).mean(1)


def distinct(operations: Operations, errors: FloatArray) -> list[int]:
    """Indices, the best first, of operations that differ from every better one of their kind."""
    kept: list[int] = []
    for index in np.argsort(errors, kind="stable").tolist():
        for other in kept:
            unsettled = errors[index] > _MUCH_BETTER * errors[other]
            if same_element(operations, index, other, _BASIN_ANGLE if unsettled else SAME_ANGLE):
                break
        else:
            kept.append(index)
    return kept


def same_element(operations: Operations, first: int, second: int, angle: float = SAME_ANGLE) -> bool:
    """Whether two operations of a batch are the same one: kind, direction (to an angle) and position."""
    if operations.improper[first] != operations.improper[second]:
        return False
    if abs(operations.angles[first] - operations.angles[second]) > SAME_ANGLE:
        return False
    gap = operations.points[first] - operations.points[second]
    if operations.improper[first] and operations.angles[first] > 3.0:  # inversions have no direction
        return float(np.linalg.norm(gap)) < SAME_DISTANCE
    direction, other = operations.directions[first], operations.directions[second]
    if abs(direction @ other) < np.cos(angle):
        return False
    if operations.improper[first]:  # planes: compared by offset
        sign = 1.0 if direction @ other > 0 else -1.0
        return abs(direction @ operations.points[first] - sign * other @ operations.points[second]) < SAME_DISTANCE
    return float(np.linalg.norm(gap - (gap @ direction) * direction)) < SAME_DISTANCE
