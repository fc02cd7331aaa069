"""From rough guesses to refined candidates: many starts in, few distinct symmetry operations out.

Cheap rejection comes first (few samples, few steps), precision last, for what is left.
"""

from dataclasses import dataclass

import numpy as np

from model._jit import kernel_array
from model.geometry.operations import Operations
from model.geometry.refinement import refine, squared_distances
from model.geometry.surface import SurfaceIndex
from model.search._distinct_kernels import keep_distinct
from model.search.context import SearchContext
from model.search.settings import DEFAULT
from model.types import AnyArray, FloatArray

_SAME_ANGLE, _SAME_DISTANCE = DEFAULT.same_angle, DEFAULT.same_distance

_BASIN_ANGLE = float(np.deg2rad(5.0))
_MUCH_BETTER = 10.0
"""An element so near to one that is so many times better has not come to rest: robust steps may stick where some faces
fit exactly and the others count as missing."""

_COARSE_STRIDE, _FINE_STRIDE = 6, 4
_MOST_CANDIDATES = 24
_MOST_LOOKED_AT = 4
_START_ANGLE = float(np.deg2rad(2.0))
_MOST_STARTS, _CLOSE_STEPS, _CLOSE_SCALE = 24, 4, 0.03
_UNPROMISING, _POOR = 2.5, 1.5
"""Candidates are dropped that map the voxels so badly (squared voxels), or whose truncated error exceeds the threshold
so many times after a few steps."""


@dataclass(frozen=True, slots=True, eq=False)
class RefinedCandidates:
    """Refined distinct ``operations``, sorted by error, with RMS deviations ``rms`` ``(k,)``; and what was ``dropped``.

    ``costs`` ``(k,)``: the RMS deviations, more where much is left unexplained: such candidates come later.
    ``dropped_errors`` ``(d,)``: the SDE on few samples that each had when it was dropped.
    """

    operations: Operations
    rms: FloatArray
    costs: FloatArray
    dropped: Operations
    dropped_errors: FloatArray


def fits_whole(context: SearchContext, starts: Operations) -> bool:
    """Whether one of the most promising starts, refined a little, takes the whole surface onto itself.

    Nothing is excused as missing here: then nothing is.
    """
    settled = context.settled_on_voxels(starts)
    errors = context.interpolated_errors(settled)
    kept = distinct(settled, errors, _BASIN_ANGLE)[:_MOST_LOOKED_AT]
    points = context.points(_COARSE_STRIDE)
    refined = refine(context.surface, points, settled[kept], 3, scale=0.12, step_tolerance=1e-5)
    squared = squared_distances(context.surface, context.samples.points[::_COARSE_STRIDE], refined)
    return bool((squared.mean(1) <= context.settings.feature_precision**2).any())


def refine_and_deduplicate(
    context: SearchContext, starts: Operations, beside: Operations | None = None
) -> RefinedCandidates:
    """Refine starts on the exact distance and keep the good ones, each once.

    Args:
        context: the shape.
        starts: may be some way off.
        beside: more of them, where part of the surface may be missing, and None where it is not: there all are tried
            where they are, too.
    """
    surface, max_error = context.surface, context.max_error
    few = context.samples.points[::_COARSE_STRIDE]
    dropped: list[Operations] = []
    dropped_errors: list[FloatArray] = []
    operations = context.settled_on_voxels(starts)
    errors = context.interpolated_errors(operations)
    # Of starts that came to rest at one place the best is enough.
    kept = distinct(operations, errors, _BASIN_ANGLE)
    cut = context.settings.truncation**2

    def drop(which: Operations) -> None:
        dropped.append(which)
        dropped_errors.append(squared_distances(surface, few, which).mean(1))

    drop(operations[kept[errors[kept] > _UNPROMISING]])
    operations = operations[kept[errors[kept] <= _UNPROMISING]]
    operations = refine(surface, context.points(_COARSE_STRIDE), operations, 3, scale=0.12, step_tolerance=1e-5)
    if beside is not None:
        operations = Operations.joined([operations, _refined_closely(context, Operations.joined([starts, beside]))])
    squared = squared_distances(surface, few, operations)
    errors = np.minimum(squared, cut).mean(1)
    good = errors <= _POOR * max_error
    dropped.append(operations[~good])
    dropped_errors.append(squared[~good].mean(1))
    operations, squared, errors = operations[good], squared[good], errors[good]
    if not context.meter.closed:
        # How much fits says more than how far off the rest is, which may be missing.
        errors = (squared / (squared + context.settings.fit_distance**2)).mean(1)
    operations = operations[distinct(operations, errors)[:_MOST_CANDIDATES]]
    operations = refine(surface, context.points(_FINE_STRIDE), operations, 6, scale=0.02)
    deviations = context.meter.measure(operations, context.judging)
    kept = distinct(operations, np.minimum(deviations.squared, cut).mean(1))
    rms = deviations.rms[kept]
    costs = rms + context.settings.missing_cost * deviations.missing_share[kept]
    return RefinedCandidates(operations[kept], rms, costs, Operations.joined(dropped), np.concatenate(dropped_errors))


def _refined_closely(context: SearchContext, starts: Operations) -> Operations:
    """The most promising starts, refined by what is near from the beginning.

    On the voxels, and as long as far images have a say, a missing part pulls even good starts away.
    """
    errors = context.interpolated_errors(starts)
    kept = distinct(starts, errors, _START_ANGLE)
    kept = kept[errors[kept] <= _UNPROMISING][:_MOST_STARTS]
    points = context.points(_COARSE_STRIDE)
    return refine(context.surface, points, starts[kept], _CLOSE_STEPS, scale=_CLOSE_SCALE, step_tolerance=1e-5)


def mean_errors(surface: SurfaceIndex, samples: FloatArray, operations: Operations) -> FloatArray:
    """The SDE of each operation on ``samples``: ``(k,)``."""
    return squared_distances(surface, samples, operations).mean(1)


def distinct(operations: Operations, errors: FloatArray, angle: float = _SAME_ANGLE) -> AnyArray:
    """Indices, the best first, of operations that differ from every better one of their kind by an angle, radians."""
    kept = np.empty(len(operations), dtype=np.int64)
    count = keep_distinct(
        kernel_array(operations.directions, np.float64),
        kernel_array(operations.points, np.float64),
        kernel_array(operations.angles, np.float64),
        operations.improper,
        kernel_array(errors, np.float64),
        np.argsort(errors, kind="stable"),
        _SAME_ANGLE,
        _SAME_DISTANCE,
        float(np.cos(angle)),
        float(np.cos(_BASIN_ANGLE)),
        _MUCH_BETTER,
        kept,
    )
    return kept[:count]
