"""Candidates of the exhaustive search: batches of candidate symmetries are fitted to a surface by exact distances.

Two kinds of steps. *Closed-form* steps map the samples best to the closest points of their images; they reach far and
converge linearly. *Damped Gauss-Newton* steps on the exact distances converge quadratically where the symmetry is
exact. Everything is in the frame of the surface, the unit frame.
"""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from model.geometry.frames import triangle_areas
from model.geometry.surface import SurfaceIndex
from model.types import BoolArray, FloatArray, IntArray

_ON_SURFACE = 1e-7
"""Closer than this the direction of the distance is rounding noise; the face's normal stands in for it."""


class Surface:
    """Exact distances and face normals of one mesh, ``(v, 3)`` and ``(f, 3)``."""

    def __init__(self, vertices: FloatArray, faces: IntArray) -> None:
        self.index = SurfaceIndex(vertices, faces)
        corners = vertices[faces]
        twice = 2.0 * triangle_areas(corners)[:, None]
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self.normals = np.divide(cross, twice, out=np.zeros_like(cross), where=twice > 0.0)

    def closest(self, points: FloatArray) -> FloatArray:
        """Closest points of ``(k, m, 3)`` points, ``(k, m, 3)``."""
        return self.index.closest(points.reshape(-1, 3))[0].reshape(points.shape)

    def errors(self, points: FloatArray) -> FloatArray:
        """Mean squared distance of each row of ``(k, m, 3)`` points: ``(k,)``."""
        return self.index.squared_distances(points.reshape(-1, 3)).reshape(points.shape[:2]).mean(1)

    def residuals(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Signed distances ``(k, m)`` of ``(k, m, 3)`` points and the unit directions ``(k, m, 3)`` they grow in."""
        flat = points.reshape(-1, 3)
        closest, squared, owners = self.index.closest(flat)
        distance = np.sqrt(squared)[:, None]
        apart = flat - closest
        near = distance < _ON_SURFACE
        direction = np.where(near, self.normals[owners], apart / np.where(near, 1.0, distance))
        signed = np.einsum("ij,ij->i", apart, direction)
        return signed.reshape(points.shape[:2]), direction.reshape(points.shape)


@dataclass(frozen=True, slots=True)
class Planes:
    """Candidate reflections: rows ``(n, d)`` ``(k, 4)``."""

    rows: FloatArray

    def __len__(self) -> int:
        return len(self.rows)

    def take(self, which: IntArray | BoolArray) -> "Planes":
        """Some of the candidates."""
        return Planes(self.rows[which])

    def replaced(self, which: IntArray, others: "Planes") -> "Planes":
        """The candidates, those at the indices ``which`` exchanged."""
        rows = self.rows.copy()
        rows[which] = others.rows
        return Planes(rows)

    def images(self, samples: FloatArray) -> FloatArray:
        """Reflected ``(m, 3)`` samples, ``(k, m, 3)``."""
        normals = self.rows[:, :3]
        heights = normals @ samples.T + self.rows[:, 3:]
        return samples[None] - 2.0 * heights[..., None] * normals[:, None]

    def icp_step(self, samples: FloatArray, surface: Surface) -> "Planes":
        """The planes that best map the samples to the closest points of their images."""
        closest = surface.closest(self.images(samples))
        mean_q, mean_o = samples.mean(0), closest.mean(1)
        product = np.einsum("mi,kmj->kij", samples - mean_q, closest - mean_o[:, None])
        normals = np.linalg.eigh(product + product.transpose(0, 2, 1))[1][:, :, 0]
        offsets = -np.einsum("ki,ki->k", normals, mean_q + mean_o) / 2.0
        return Planes(np.column_stack([normals, offsets]))

    def tangents(self, samples: FloatArray) -> FloatArray:
        """How the images move with the two tilts and the offset: ``(k, m, 3 parameters, 3)``."""
        normals = self.rows[:, :3]
        heights = normals @ samples.T + self.rows[:, 3:]
        moves = [
            -2.0 * ((tilt @ samples.T)[..., None] * normals[:, None] + heights[..., None] * tilt[:, None])
            for tilt in perpendicular(normals)
        ]
        moves.append(np.broadcast_to(-2.0 * normals[:, None], moves[0].shape))
        return np.stack(moves, axis=2)

    def moved(self, delta: FloatArray) -> "Planes":
        """The candidates after a small step ``(k, 3)`` of the parameters of `tangents`."""
        first, second = perpendicular(self.rows[:, :3])
        normals = self.rows[:, :3] + delta[:, :1] * first + delta[:, 1:2] * second
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return Planes(np.column_stack([normals, self.rows[:, 3] + delta[:, 2]]))


@dataclass(frozen=True, slots=True)
class Axes:
    """Candidate rotations about axes: ``directions``, ``points`` ``(k, 3)``.

    ``angles`` is ``(k, 1)``, or ``(k, m)`` to rotate each sample by an angle of its own. ``free``: they are fitted too.
    """

    directions: FloatArray
    points: FloatArray
    angles: FloatArray
    free: bool = False

    def __len__(self) -> int:
        return len(self.directions)

    def take(self, which: IntArray | BoolArray) -> "Axes":
        """Some of the candidates."""
        return Axes(self.directions[which], self.points[which], self.angles[which], self.free)

    def replaced(self, which: IntArray, others: "Axes") -> "Axes":
        """The candidates, those at the indices ``which`` exchanged."""
        directions, points, angles = self.directions.copy(), self.points.copy(), self.angles.copy()
        directions[which], points[which], angles[which] = others.directions, others.points, others.angles
        return Axes(directions, points, angles, self.free)

    def _rotated(self, vectors: FloatArray) -> FloatArray:
        """``(k, m, 3)`` rotated vectors (Rodrigues)."""
        w = self.directions[:, None]
        along = np.einsum("kmi,kji->kmj", vectors, w)
        cosine, sine = np.cos(self.angles)[..., None], np.sin(self.angles)[..., None]
        return cosine * vectors + sine * np.cross(w, vectors) + (1.0 - cosine) * along * w

    def images(self, samples: FloatArray) -> FloatArray:
        """Rotated ``(m, 3)`` samples, ``(k, m, 3)``."""
        return self.points[:, None] + self._rotated(samples[None] - self.points[:, None])

    def icp_step(self, samples: FloatArray, surface: Surface) -> "Axes":
        """The rotations that best map the samples to the closest points of their images; the angle is fitted too.

        The best rigid motion (Kabsch), less its shift along the axis.
        """
        closest = surface.closest(self.images(samples))
        mean_q, mean_o = samples.mean(0), closest.mean(1)
        product = np.einsum("kmi,mj->kij", closest - mean_o[:, None], samples - mean_q)
        left, _, right = np.linalg.svd(product)
        left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
        matrices = left @ right
        return axes_of(matrices, mean_o - matrices @ mean_q)

    def tangents(self, samples: FloatArray) -> FloatArray:
        """How the images move with two tilts, two shifts and, if free, the angle: ``(k, m, 4 or 5, 3)``."""
        arms = samples[None] - self.points[:, None]
        rotated = self._rotated(arms)
        moves: list[FloatArray] = []
        sides = perpendicular(self.directions)
        for side in sides:
            omega = np.broadcast_to(side[:, None], arms.shape)
            moves.append(np.cross(omega, rotated) - self._rotated(np.cross(omega, arms)))
        for side in sides:
            shift = np.broadcast_to(side[:, None], arms.shape)
            moves.append(shift - self._rotated(shift))
        if self.free:
            moves.append(np.cross(self.directions[:, None], rotated))
        return np.stack(moves, axis=2)

    def moved(self, delta: FloatArray) -> "Axes":
        """The candidates after a small step ``(k, 4 or 5)`` of the parameters of `tangents`."""
        first, second = perpendicular(self.directions)
        omega = delta[:, :1] * first + delta[:, 1:2] * second
        directions = self.directions + np.cross(omega, self.directions)
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        points = self.points + delta[:, 2:3] * first + delta[:, 3:4] * second
        points -= np.einsum("ki,ki->k", points, directions)[:, None] * directions
        angles = self.angles + delta[:, 4:5] if self.free else self.angles
        return Axes(directions, points, angles, self.free)


def axes_of(matrices: FloatArray, shifts: FloatArray) -> Axes:
    """Axes of rigid motions ``x -> matrix x + shift``, ``(k, 3, 3)`` and ``(k, 3)``; angles within 0 and π, free."""
    directions = np.linalg.eigh(matrices + matrices.transpose(0, 2, 1))[1][:, :, 2]
    spin = np.stack(
        [
            matrices[:, 2, 1] - matrices[:, 1, 2],
            matrices[:, 0, 2] - matrices[:, 2, 0],
            matrices[:, 1, 0] - matrices[:, 0, 1],
        ],
        axis=1,
    )
    sines = np.einsum("ki,ki->k", spin, directions)
    directions = directions * np.where(sines < 0.0, -1.0, 1.0)[:, None]
    angles = np.arctan2(np.abs(sines), np.trace(matrices, axis1=1, axis2=2) - 1.0)
    across = shifts - np.einsum("ki,ki->k", shifts, directions)[:, None] * directions
    cotangent = 1.0 / np.tan(np.maximum(angles, 1e-3) / 2.0)
    points = 0.5 * (across + cotangent[:, None] * np.cross(directions, across))
    return Axes(directions, points, angles[:, None], True)


def line_distances(directions: FloatArray, points: FloatArray, others: FloatArray) -> FloatArray:
    """Distances ``(k, l)`` of ``others`` ``(l, 3)`` from the lines through ``points`` along ``directions``."""
    apart = others[None] - points[:, None]
    along = np.einsum("kli,ki->kl", apart, directions)
    return np.sqrt(np.maximum(np.square(apart).sum(-1) - along**2, 0.0))


def perpendicular(directions: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors at right angles to each unit row and to each other, both ``(k, 3)``."""
    helpers = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first: FloatArray = np.cross(directions, helpers).astype(np.float64)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second: FloatArray = np.cross(directions, first).astype(np.float64)
    return first, second


def tilted(direction: FloatArray, angle: float, count: int = 8) -> FloatArray:
    """``(count, 3)`` unit vectors at an ``angle`` in radians from a direction (3,), spread around it."""
    first, second = (side[0] for side in perpendicular(direction[None]))
    around = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False, dtype=np.float64)[:, None]
    sides: FloatArray = np.cos(around) * first + np.sin(around) * second
    return np.cos(angle) * direction + np.sin(angle) * sides


Candidates = TypeVar("Candidates", Planes, Axes)


def polish(moves: Candidates, samples: FloatArray, surface: Surface, steps: int) -> tuple[Candidates, FloatArray]:
    """Damped Gauss-Newton (Levenberg-Marquardt) on the exact distances of ``(m, 3)`` samples, all candidates at once.

    Returns:
        the fitted candidates and their errors on the samples ``(k,)``. A step that does not help is not taken.
    """
    count = len(moves)
    signed, direction = surface.residuals(moves.images(samples))
    errors = np.square(signed).mean(1)
    damping = np.full(count, 1e-3)
    active = np.ones(count, dtype=bool)
    for _ in range(steps):
        which = np.flatnonzero(active).astype(np.int32)
        if not len(which):
            break
        part = moves.take(which)
        slopes = np.einsum("kmpi,kmi->kmp", part.tangents(samples), direction[which])
        normal = np.einsum("kmp,kmq->kpq", slopes, slopes)
        force = np.einsum("kmp,km->kp", slopes, signed[which])
        scale = np.einsum("kpp->kp", normal) + 1e-12 * len(samples)
        normal[:, np.arange(scale.shape[1]), np.arange(scale.shape[1])] += damping[which, None] * scale
        delta = -np.linalg.solve(normal, force[..., None])[..., 0]
        size = np.abs(delta).max(1)
        delta *= np.minimum(1.0, 0.2 / np.maximum(size, 1e-300))[:, None]
        trial = part.moved(delta)
        trial_signed, trial_direction = surface.residuals(trial.images(samples))
        trial_errors = np.square(trial_signed).mean(1)
        better = trial_errors < errors[which]
        gain = errors[which] - trial_errors
        moves = moves.replaced(which[better], trial.take(better))  # pyright: ignore[reportArgumentType]
        signed[which[better]], direction[which[better]] = trial_signed[better], trial_direction[better]
        # An approximate minimum needs no more digits than its error has meaning.
        slow = better & (gain < 1e-4 * errors[which]) & (errors[which] > 1e-14)
        converged = (size < 1e-10) | slow | (trial_errors < 1e-30)
        errors[which[better]] = trial_errors[better]
        damping[which] = np.clip(np.where(better, damping[which] / 10.0, damping[which] * 10.0), 1e-9, 1e6)
        active[which[converged | (~better & (damping[which] > 1e4))]] = False
    return moves, errors
