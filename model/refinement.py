"""Refinement of symmetry operations on the exact distance, robust against missing parts and noise.

Where an operation T maps the surface nearly onto itself, its element (plane, axis, centre) is moved so that the images
of surface samples come closest to the surface. Gauss-Newton on the exact distances: for a sample q with image
x = T(q), distance r and direction m of the distance, a small rigid motion ``(w, v)`` of the element changes r by
``(x X m - q X R^T m).w + (m - R^T m).v``, with R the linear part of T. It holds for planes, axes and centres alike, and
converges quadratically on exactly symmetric shapes, where closed-form steps towards fixed closest points
(iterative closest point) converge linearly.
"""

import numpy as np

from model._gauss_newton import steps as gauss_newton_steps
from model._jit import kernel_array
from model.operations import Operations
from model.surface import SurfaceIndex
from model.types import AnyArray, FloatArray

START_SCALE = 0.1
"""Distances, unit frame, beyond which a sample loses its say at first ..."""

FINAL_SCALE = 0.004
"""... and in the end at least; in between the scale follows the residuals."""

_QUANTILE = 0.75
_SPREAD = 2.5
"""The scale is so many times this quantile of the distances: up to a quarter of the surface may be missing."""

_SHRINK = 0.6
_DAMPING = 1e-7
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
    settled: float = 1e-9,
) -> Operations:
    """Refine all operations at once, each until it stands still.

    Args:
        surface: what to measure against, unit frame.
        samples: ``(n, 3)`` points on it.
        operations: where to start; their kinds and angles stay.
        steps: at most so many Gauss-Newton steps.
        scale: the first robust scale, unit frame; small when the start is known to be good.
        settled: an operation whose element moves less than this in a step is left alone; one that fits only roughly,
            when it moves less than `_ROUGHLY` of its typical distance.
    """
    samples = kernel_array(samples, np.float64)
    moving = np.arange(len(operations))
    scales = np.full(len(operations), scale / _SHRINK)
    for _ in range(steps):
        if not len(moving):
            break
        part = operations[moving]
        images = part.apply(samples)
        closest, squared, owners = surface.closest(images.reshape(-1, 3))
        normals = surface.normals(owners).reshape(images.shape)
        squared = squared.reshape(images.shape[:2])
        motion, part_scales = np.empty((len(part), 6)), scales[moving]
        gauss_newton_steps(
            samples,
            images,
            closest.reshape(images.shape),
            squared,
            normals,
            part.matrices,
            part_scales,
            _SHRINK,
            FINAL_SCALE,
            _SPREAD,
            _QUANTILE,
            _CONTACT,
            _DAMPING,
            motion,
        )
        scales[moving] = part_scales
        turns, shifts = _clipped(motion[:, :3], _LARGEST_TURN), _clipped(motion[:, 3:], _LARGEST_SHIFT)
        operations = _replaced(operations, moving, part.moved(turns, shifts))
        moving = moving[np.abs(motion).max(1) > settled + _ROUGHLY * np.sqrt(squared.mean(1))]
    return operations


def _clipped(vectors: FloatArray, largest: float) -> FloatArray:
    length = np.sqrt(np.square(vectors).sum(1))[:, None]
    return vectors * np.minimum(1.0, largest / np.maximum(length, 1e-300))


def _replaced(operations: Operations, index: AnyArray, new: Operations) -> Operations:
    directions, points = operations.directions.copy(), operations.points.copy()
    directions[index], points[index] = new.directions, new.points
    return Operations(directions, points, operations.angles, operations.improper)
