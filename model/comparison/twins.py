"""Whether two meshes are congruent, mirror images of each other, or neither.

No symmetry of a single part can tell this: a fan of group C5 has rotations of its own and still differs from its twin.
So one mesh is laid on the other by a search over all rotations, once as it is and once mirrored, and what counts is the
largest distance that is left anywhere on either surface.
"""

from bisect import insort
from dataclasses import dataclass
from functools import cache
from typing import Literal, TypeAlias

import numpy as np

from model.geometry.integrals import unit_frame
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.meshes.mesh import Mesh
from model.types import FloatArray

Relation: TypeAlias = Literal["congruent", "mirror_images", "both", "neither"]

TOLERANCE = 5e-4
"""Of a pair's larger size; two tessellations of one part differ by less, and features that matter by more."""

_GLANCE, _FIT, _REFIT, _JUDGE = 120, 400, 2000, 6000
_ROTATIONS = 3000
_SPINS = 144
_TRIED, _FINISHED, _LOOKED_AT = 24, 6, 300
_STEPS = 20
_STILL = 1e-13
_ROUND = 0.02
"""Two moments of inertia nearer to each other than this share of the larger are tried at every angle."""


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """The best way to lay one mesh on another: ``matrix`` (4, 4) for column vectors, and what distance is left."""

    matrix: FloatArray
    deviation: float


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """What two meshes are to each other. Lengths in their own unit.

    Attributes:
        relation: ``both`` is congruent and mirror images: a part that is its own mirror image.
        direct: the best rotation and shift that takes the first to the second.
        mirrored: the best that mirrors it too.
        tolerance: largest deviation that counts as none.
    """

    relation: Relation
    direct: Fit
    mirrored: Fit
    tolerance: float


def compare(first: Mesh, second: Mesh, tolerance: float | None = None) -> Comparison:
    """Lay the first mesh on the second, as it is and mirrored; ``tolerance`` is in input units."""
    frames = [unit_frame(mesh.vertices, mesh.faces) for mesh in (first, second)]
    scale = max(frame.scale for frame in frames)
    limit = TOLERANCE * scale if tolerance is None else tolerance
    target = _Target((second.vertices - frames[1].center) / scale, second)
    fits: list[Fit] = []
    for mirror in (np.eye(3), np.diag([-1.0, 1.0, 1.0])):
        moved = (first.vertices - frames[0].center) / scale @ mirror
        turn, shift, left = _register(moved, first, target)
        matrix = np.eye(4)
        matrix[:3, :3] = turn @ mirror
        matrix[:3, 3] = frames[1].center + scale * shift - matrix[:3, :3] @ frames[0].center
        fits.append(Fit(matrix, left * scale))
    near = [fit.deviation <= limit for fit in fits]
    relation: Relation = (
        ("both" if near[1] else "congruent") if near[0] else ("mirror_images" if near[1] else "neither")
    )
    return Comparison(relation, fits[0], fits[1], limit)


class _Target:
    """The mesh that others are laid on, about its centre."""

    def __init__(self, vertices: FloatArray, mesh: Mesh) -> None:
        self.surface = SurfaceIndex(vertices, mesh.faces)
        self.samples = _spread(vertices, mesh, seed=3)
        self.axes, self.moments = _inertia(vertices, mesh)
        corners = vertices[mesh.faces]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self.normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)


_Motion: TypeAlias = tuple[FloatArray, FloatArray, float]


def _register(vertices: FloatArray, mesh: Mesh, target: _Target) -> _Motion:
    """Rotation (3, 3), shift (3,) and largest distance left, of vertices about their centre."""
    axes, moments = _inertia(vertices, mesh)
    turns = np.concatenate([_aligned(axes, moments, target), _everywhere()])
    glance, _ = sample_surface(vertices, mesh.faces, _GLANCE, seed=1)
    coarse, _ = sample_surface(vertices, mesh.faces, _FIT, seed=2)
    fine, _ = sample_surface(vertices, mesh.faces, _REFIT, seed=5)
    judged = _spread(vertices, mesh, seed=4)

    def finished(turn: FloatArray, shift: FloatArray) -> _Motion:
        turn, shift = _refined(fine, turn, shift, target, 2 * _STEPS, robust=False)
        return turn, shift, _largest_distance(judged, vertices, mesh, turn, shift, target)

    tried: list[_Motion] = []
    for start in _unlike(turns, _errors(glance, turns, target)):
        turn, shift = _refined(coarse, turns[start], np.zeros(3), target, _STEPS)
        left = target.surface.mean_squared_distance(coarse @ turn.T + shift)
        tried.append((turn, shift, left))
        if left < _STILL and (done := finished(turn, shift))[2] < 1e-6:
            return done
    tried.sort(key=lambda motion: motion[2])
    return min((finished(turn, shift) for turn, shift, _ in tried[:_FINISHED]), key=lambda motion: motion[2])


def _errors(samples: FloatArray, turns: FloatArray, target: _Target) -> FloatArray:
    """Mean squared distances under every rotation; infinity for those that are surely not among the best."""
    errors = np.full(len(turns), np.inf)
    best: list[float] = []
    for index, turn in enumerate(turns):
        bound = best[_LOOKED_AT - 1] if len(best) >= _LOOKED_AT else np.inf
        errors[index] = target.surface.mean_squared_distance(samples @ turn.T, bound)
        if errors[index] < bound:
            insort(best, float(errors[index]))
    return errors


def _unlike(turns: FloatArray, errors: FloatArray) -> list[int]:
    """The best starts, no two of them within some degrees."""
    chosen: list[int] = []
    for index in np.argsort(errors, kind="stable").tolist():
        traces = [float(np.sum(turns[index] * turns[other])) for other in chosen]
        if all(trace < 1.0 + 2.0 * np.cos(np.deg2rad(4.0)) for trace in traces):
            chosen.append(index)
        if len(chosen) == _TRIED:
            break
    return chosen


def _refined(
    samples: FloatArray, turn: FloatArray, shift: FloatArray, target: _Target, steps: int, robust: bool = True
) -> tuple[FloatArray, FloatArray]:
    """The turn and shift that bring samples nearest to the target's planes, by damped Gauss-Newton steps."""
    damping, last = 1e-9, np.inf
    points = samples @ turn.T + shift
    for _ in range(steps):
        found, squared, owners = target.surface.closest(points)
        error = float(squared.mean())
        if error < _STILL**2 or abs(last - error) <= 1e-9 * error:
            break
        last = error
        # Those far off have less of a say: a feature that only one has shall not pull the rest along.
        usual = 4.0 * max(float(np.median(squared)), 1e-24) if robust else np.inf
        weights = 1.0 / (1.0 + squared / usual)
        normals = target.normals[owners]
        rows = np.concatenate([np.cross(points, normals), normals], axis=1)
        residuals = np.einsum("ij,ij->i", found - points, normals)
        weighted = rows * weights[:, None]
        matrix = weighted.T @ rows + damping * len(rows) * np.eye(6)
        step = np.asarray(np.linalg.solve(matrix, weighted.T @ residuals), dtype=np.float64)
        small = _rotation(step[:3])
        turn, shift = small @ turn, small @ shift + step[3:]
        points = samples @ turn.T + shift
    return turn, shift


def _largest_distance(
    judged: FloatArray, vertices: FloatArray, mesh: Mesh, turn: FloatArray, shift: FloatArray, target: _Target
) -> float:
    """The largest distance of either surface from the other."""
    there = float(target.surface.squared_distances(judged @ turn.T + shift).max())
    back = float(SurfaceIndex(vertices @ turn.T + shift, mesh.faces).squared_distances(target.samples).max())
    return max(there, back) ** 0.5


def _spread(vertices: FloatArray, mesh: Mesh, seed: int) -> FloatArray:
    """Points all over a surface: samples, and vertices, of which at most so many again."""
    used = np.unique(mesh.faces)
    used = used[:: max(1, len(used) // _JUDGE)]
    return np.concatenate([sample_surface(vertices, mesh.faces, _JUDGE, seed=seed)[0], vertices[used]])


def _inertia(vertices: FloatArray, mesh: Mesh) -> tuple[FloatArray, FloatArray]:
    """Principal axes (rows, right-handed) and moments of the surface, in ascending order."""
    points, _ = sample_surface(vertices, mesh.faces, 20_000, seed=0)
    moments, vectors = np.linalg.eigh(points.T @ points / len(points))
    axes = vectors.T
    axes[2] *= np.sign(np.linalg.det(axes))
    return axes, moments


def _aligned(axes: FloatArray, moments: FloatArray, target: _Target) -> FloatArray:
    """Rotations that lay principal axes on each other, and about an axis with equal moments across at every angle."""
    flips = np.array([np.diag(signs) for signs in ((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1))], dtype=float)
    spins = [np.eye(3)]
    for axis, (i, j) in ((2, (0, 1)), (0, (1, 2))):
        if moments[j] - moments[i] < _ROUND * moments[2]:
            direction = np.eye(3)[axis]
            spins += [_rotation(angle * direction) for angle in 2.0 * np.pi * np.arange(1, _SPINS) / _SPINS]
    return np.concatenate([target.axes.T @ np.stack(spins) @ flip @ axes for flip in flips])


@cache
def _everywhere() -> FloatArray:
    """Rotations (k, 3, 3) spread over all there are, some 20 degrees apart: quaternions along a spiral."""
    count = np.arange(_ROTATIONS) + 0.5
    share = count / _ROTATIONS
    first, second = 2.0 * np.pi * count / 2.0**0.5, 2.0 * np.pi * count / 1.533751168755204288118041
    x, y = np.sqrt(share) * np.sin(first), np.sqrt(share) * np.cos(first)
    z, w = np.sqrt(1.0 - share) * np.sin(second), np.sqrt(1.0 - share) * np.cos(second)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows).transpose(2, 0, 1)


def _rotation(vector: FloatArray) -> FloatArray:
    """The rotation (3, 3) about a vector (3,) by its length in radians."""
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * (skew @ skew)
