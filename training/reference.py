"""Reference planes: an exhaustive, slow search for the clear planes of a shape. It knows nothing of the network.

A plane is clear when its exact symmetry error is below 1e-6. Starts cover the hemisphere; each is refined on exact
distances until it stops moving.
"""

import numpy as np

from model.frames import inertia_frame
from model.sampling import sample_surface
from model.surface import SurfaceIndex
from model.transforms import reflect
from model.types import FloatArray, IntArray

CLEAR_ERROR = 1e-6
STARTS = 64
_COARSE_SAMPLES, _FINE_SAMPLES, _JUDGE_SAMPLES = 128, 800, 2000
_COARSE_STEPS, _FINE_STEPS, _POLISH_STEPS = 10, 24, 100
_PROMISING = 3e-4
"""Steps converge linearly: a start with a larger error after the coarse steps is not on its way to a clear plane."""
_LARGEST = 32
"""A surface of revolution has planes without end: no more are listed."""
_SAME_ANGLE = np.deg2rad(1.0)


def hemisphere(count: int) -> FloatArray:
    """``(count, 3)`` unit directions spread evenly over a hemisphere (Fibonacci lattice)."""
    index = np.arange(count) + 0.5
    z = index / count
    angle = np.pi * (1.0 + 5.0**0.5) * index
    radius = np.sqrt(1.0 - z * z)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])


def refine_step(plane: FloatArray, surface: SurfaceIndex, samples: FloatArray) -> FloatArray:
    """One closed-form step: the plane that best maps the samples to the closest points of their reflections.

    With samples q and closest points o, the normal is the eigenvector of the smallest eigenvalue of the symmetric
    part of ``sum (q - mean q)(o - mean o)^T``, and the offset ``-n.(mean q + mean o) / 2``.
    """
    closest, _, _ = surface.closest(reflect(samples, plane))
    mean_q, mean_o = samples.mean(0), closest.mean(0)
    product = (samples - mean_q).T @ (closest - mean_o)
    normal = np.linalg.eigh(product + product.T)[1][:, 0]
    return np.append(normal, -normal @ (mean_q + mean_o) / 2.0)


def clear_planes(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """All clear planes the search finds: ``(k, 4)`` rows ``(n, d)`` in the frame of ``vertices``, the unit frame.

    Of a continuous family it lists some members, 32 planes at most.
    """
    surface = SurfaceIndex(vertices, faces)
    coarse, _ = sample_surface(vertices, faces, _COARSE_SAMPLES, seed=101)
    fine, _ = sample_surface(vertices, faces, _FINE_SAMPLES, seed=102)
    judge, _ = sample_surface(vertices, faces, _JUDGE_SAMPLES, seed=103)
    starts = np.vstack([inertia_frame(vertices, faces)[0], np.eye(3), hemisphere(STARTS)])
    found: list[FloatArray] = []
    seen: list[FloatArray] = []

    def try_plane(plane: FloatArray) -> None:
        plane = _settled(plane, surface, fine, _FINE_STEPS)
        if _known(plane, found):
            return
        if surface.mean_squared_distance(reflect(judge, plane), CLEAR_ERROR) <= CLEAR_ERROR:
            found.append(_settled(plane, surface, fine, _POLISH_STEPS))

    for start in starts:
        plane = _coarse(np.append(start, 0.0), surface, coarse, seen)
        if plane is None:
            continue
        seen.append(plane)
        if surface.mean_squared_distance(reflect(coarse, plane), _PROMISING) <= _PROMISING:
            try_plane(plane)
    # A plane reflected in another one is a symmetry plane too: what the starts missed of a group follows from the rest.
    pairs = 0
    while pairs < len(found) ** 2 and len(found) < _LARGEST:
        mirror, plane = found[pairs % len(found)], found[pairs // len(found)]
        pairs += 1
        normal = plane[:3] - 2.0 * (plane[:3] @ mirror[:3]) * mirror[:3]
        image = np.append(normal, plane[3] - 2.0 * (plane[:3] @ mirror[:3]) * mirror[3])
        if not _known(image, found):
            try_plane(image)
    return np.stack(found) if found else np.zeros((0, 4))


def _settled(plane: FloatArray, surface: SurfaceIndex, samples: FloatArray, steps: int) -> FloatArray:
    for _ in range(steps):
        moved = refine_step(plane, surface, samples)
        settled = np.abs(moved - plane * np.sign(moved[:3] @ plane[:3])).max() < 1e-9
        plane = moved
        if settled:
            break
    return plane


def _coarse(plane: FloatArray, surface: SurfaceIndex, samples: FloatArray, seen: list[FloatArray]) -> FloatArray | None:
    """Refine on few samples; None as soon as the way leads to a plane that was reached before."""
    for step in range(_COARSE_STEPS):
        plane = refine_step(plane, surface, samples)
        if step % 3 == 2 and _known(plane, seen):
            return None
    return None if _known(plane, seen) else plane


def _known(plane: FloatArray, others: list[FloatArray]) -> bool:
    limit = np.cos(_SAME_ANGLE)
    for other in others:
        cosine = float(plane[:3] @ other[:3])
        if abs(cosine) > limit and abs(plane[3] - np.sign(cosine) * other[3]) < 0.01:
            return True
    return False
