"""Refinement of symmetry operations on the exact distance, robust against missing parts and noise.

Where an operation T maps the surface nearly onto itself, its element (plane, axis, centre) is moved so that the images
of surface samples come closest to the surface. Gauss-Newton on the exact distances: for a sample q with image
x = T(q), distance r and direction m of the distance, a small rigid motion ``(w, v)`` of the element changes r by
``(x X m - q X R^T m).w + (m - R^T m).v``, with R the linear part of T. It holds for planes, axes and centres alike, and
converges quadratically on exactly symmetric shapes, where closed-form steps towards fixed closest points
(iterative closest point) converge linearly.
"""

import numpy as np

from model._jit import kernel_array
from model.geometry import _operation_kernels as _kernels
from model.geometry.operations import Operations, linear_parts
from model.geometry.surface import SurfaceIndex
from model.types import FloatArray

START_SCALE = 0.1
"""Distances, unit frame, beyond which a sample loses its say at first ..."""

FINAL_SCALE = 0.004
"""... and in the end at least; in between the scale follows the residuals."""

_QUANTILE = 0.75
_SPREAD = 2.5
"""The scale is so many times this quantile of the distances: up to a quarter of the surface may be missing."""

_SHRINK = 0.6
_DAMPING = 1e-9
_ROUGHLY = 0.02
_LARGEST_TURN, _LARGEST_SHIFT = 0.2, 0.08
_CONTACT = 1e-7
"""Nearer than this to the surface, the direction of the distance is rounding; the face's normal takes its place."""


def refine_planes(surface: SurfaceIndex, samples: FloatArray, planes: FloatArray, steps: int = 30) -> FloatArray:
    """Refine planes ``(k, 4)``, rows ``(n, d)``, on samples ``(n, 3)`` of the surface, all in the unit frame."""
    return refine(surface, samples, Operations.reflections(planes), steps).planes


def refine(
    surface: SurfaceIndex,
    samples: FloatArray,
    operations: Operations,
    steps: int = 30,
    *,
    scale: float = START_SCALE,
    step_tolerance: float = 1e-9,
) -> Operations:
    """Refine all operations at once, each until it stands still.

    Args:
        surface: what to measure against, unit frame.
        samples: ``(n, 3)`` points on it.
        operations: where to start; their kinds and angles stay.
        steps: at most so many Gauss-Newton steps.
        scale: the first robust scale, unit frame; small when the start is known to be good.
        step_tolerance: an operation whose element moves less than this in a step is left alone; one that fits only
            roughly, when it moves less than `_ROUGHLY` of its typical distance.
    """
    directions, points = _refined(
        surface,
        samples,
        operations,
        0,
        steps,
        scale,
        FINAL_SCALE,
        _QUANTILE,
        True,
        step_tolerance,
        np.zeros((0, 3)),
        np.zeros(3),
    )
    return Operations(directions, points, operations.angles, operations.improper)


def refine_frame(
    surface: SurfaceIndex,
    samples: FloatArray,
    operations: Operations,
    frame: FloatArray,
    centre: FloatArray,
    steps: int = 30,
    *,
    scale: float = START_SCALE,
    final_scale: float = FINAL_SCALE,
    quantile: float | None = _QUANTILE,
    trust_rms: bool = True,
    step_tolerance: float = 1e-9,
) -> tuple[FloatArray, FloatArray]:
    """Fit the frame of a symmetry group to several of its operations at once, with one rigid motion for all.

    What noise does to one element is averaged over all of them, and their relations stay exact.

    Args:
        surface: what to measure against, unit frame.
        samples: ``(n, 3)`` points on it.
        operations: members of the group where the frame is now.
        frame: ``(3, 3)``, a proper rotation whose rows are the frame's axes.
        centre: ``(3,)``, the fixed point of the group.
        steps: at most so many Gauss-Newton steps.
        scale: the first robust scale.
        final_scale: the robust scale never falls below this.
        quantile: of the distances, which the robust scale follows; small where much of the surface is missing. None: it
            shrinks from step to step whatever they are, until only what fits exactly counts.
        trust_rms: keep the scale above the RMS distance; not where much is missing.
        step_tolerance: a motion smaller than this ends the steps.

    Returns:
        frame and centre after the fit; the frame is orthonormal to rounding.
    """
    if not len(operations):
        return frame, centre
    directions, points = _refined(
        surface,
        samples,
        operations,
        len(operations),
        steps,
        scale,
        final_scale,
        quantile,
        trust_rms,
        step_tolerance,
        frame,
        centre,
    )
    left, _, right = np.linalg.svd(directions[-3:])
    return left @ right, points[-1]


def _refined(
    surface: SurfaceIndex,
    samples: FloatArray,
    operations: Operations,
    together: int,
    steps: int,
    scale: float,
    final_scale: float,
    quantile: float | None,
    trust_rms: bool,
    step_tolerance: float,
    carried: FloatArray,
    centre: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Directions and points ``(k, 3)`` after the fit, those of the ``carried`` directions at ``centre`` behind them."""
    along = np.where(operations.improper, -1.0, 1.0)
    directions = surface.to_tree(np.concatenate([operations.directions, carried]))
    points = surface.to_tree(np.concatenate([operations.points, np.broadcast_to(centre, carried.shape)]))
    _kernels.refine(
        surface.to_tree(samples),
        directions,
        points,
        kernel_array(operations.angles, np.float64),
        along,
        together,
        steps,
        scale,
        final_scale,
        _SHRINK,
        0.0 if quantile is None else _SPREAD,
        0.5 if quantile is None else quantile,
        trust_rms,
        _DAMPING,
        _CONTACT,
        _LARGEST_TURN,
        _LARGEST_SHIFT,
        step_tolerance,
        0.0 if quantile is None else _ROUGHLY,
        surface.tree,
    )
    surface.require_work()
    return surface.from_tree(directions), surface.from_tree(points)


def squared_distances(surface: SurfaceIndex, samples: FloatArray, operations: Operations) -> FloatArray:
    """Squared distances ``(k, n)`` from the surface of the images of samples ``(n, 3)`` under every operation."""
    squared = np.empty((len(operations), len(samples)))
    points = surface.to_tree(operations.points)
    # In the axes A of the tree the linear part R becomes A R A^T: the same kind of turn about the turned direction.
    linear = linear_parts(surface.to_tree(operations.directions), operations.angles, operations.improper)
    _kernels.image_distances(surface.to_tree(samples), points, linear, surface.tree, squared)
    surface.require_work()
    return squared
