"""From rough guesses to refined candidates: many starts in, few distinct symmetry operations out.

Cheap rejection comes first (few samples, few steps), precision last, for what is left.
"""

from dataclasses import dataclass

import numpy as np

from model.operations import Operations
from model.refinement import refine
from model.surface import SurfaceIndex
from model.types import FloatArray

SAME_ANGLE = float(np.deg2rad(1.5))
SAME_DISTANCE = 0.015
"""Two elements of the same kind within this angle and distance (unit frame) are one."""

_COARSE_EVERY = 5
_CUT = 0.06
"""Distances count up to here while candidates are sifted: a hole in the surface must not hide a symmetry."""

_HOPELESS, _POOR = 4.0, 2.0
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


def settle(surface: SurfaceIndex, samples: FloatArray, starts: Operations, max_error: float) -> Settled:
    """Refine ``starts``, in the unit frame, on ``samples`` ``(n, 3)`` of the surface; keep the good ones, each once."""
    coarse = samples[::_COARSE_EVERY]
    dropped: list[Operations] = []
    dropped_errors: list[FloatArray] = []
    operations = starts
    errors = np.zeros(len(operations))
    for steps, scale, bound in ((3, 0.15, _HOPELESS), (3, 0.04, _POOR)):
        operations = refine(surface, coarse, operations, steps, scale=scale, settled=1e-5)
        squared = squared_distances(surface, coarse, operations)
        errors = np.minimum(squared, _CUT * _CUT).mean(1)
        good = errors <= bound * max_error
        dropped.append(operations[~good])
        dropped_errors.append(squared[~good].mean(1))
        operations, errors = operations[good], errors[good]
        kept = distinct(operations, errors)
        operations, errors = operations[kept], errors[kept]
    if len(operations):
        operations = refine(surface, samples, operations, 8, scale=0.02)
        errors = mean_errors(surface, samples, operations)
        kept = distinct(operations, errors)
        operations, errors = operations[kept], errors[kept]
    return Settled(operations, errors, Operations.joined(dropped), np.concatenate(dropped_errors))


def squared_distances(surface: SurfaceIndex, samples: FloatArray, operations: Operations) -> FloatArray:
    """Squared distances ``(k, n)`` of the images of all samples."""
    if not len(operations):
        return np.zeros((0, len(samples)))
    return surface.squared_distances(operations.apply(samples).reshape(-1, 3)).reshape(len(operations), -1)


def mean_errors(surface: SurfaceIndex, samples: FloatArray, operations: Operations) -> FloatArray:
    """The SDE of each operation on ``samples``: ``(k,)``."""
    return squared_distances(surface, samples, operations).mean(1)


def distinct(operations: Operations, errors: FloatArray) -> list[int]:
    """Indices, the best first, of operations that differ from every better one of their kind."""
    kept: list[int] = []
    for index in np.argsort(errors, kind="stable").tolist():
        if not any(same_element(operations, index, other) for other in kept):
            kept.append(index)
    return kept


def same_element(operations: Operations, first: int, second: int) -> bool:
    """Whether two operations of a batch are the same one: kind, direction and position."""
    if operations.improper[first] != operations.improper[second]:
        return False
    if abs(operations.angles[first] - operations.angles[second]) > SAME_ANGLE:
        return False
    gap = operations.points[first] - operations.points[second]
    if operations.improper[first] and operations.angles[first] > 3.0:  # inversions have no direction
        return float(np.linalg.norm(gap)) < SAME_DISTANCE
    direction, other = operations.directions[first], operations.directions[second]
    if abs(direction @ other) < np.cos(SAME_ANGLE):
        return False
    if operations.improper[first]:  # planes: compared by offset
        sign = 1.0 if direction @ other > 0 else -1.0
        return abs(direction @ operations.points[first] - sign * other @ operations.points[second]) < SAME_DISTANCE
    return float(np.linalg.norm(gap - (gap @ direction) * direction)) < SAME_DISTANCE
