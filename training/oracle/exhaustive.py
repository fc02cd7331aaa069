"""The exhaustive search for all reflection planes and rotation axes of a mesh: slow, and independent of the detector.

Starts cover the hemisphere and several centres. Each is moved by closed-form steps, then by damped Gauss-Newton steps
on the exact distance (`alignment`), measured on other samples. Products of what is found are tried
until nothing new appears. All in the unit frame.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from model.geometry.frames import inertia_frame
from model.geometry.sampling import sample_surface
from model.types import BoolArray, FloatArray, IntArray
from training.oracle.alignment import Axes, Candidates, Planes, Surface, polish, tilted
from training.oracle.continuous_families import (
    across,
    family_planes,
    of_family,
    planes_through,
    sphere_centre,
    surplus_axes,
    surplus_planes,
)
from training.oracle.products import (
    SAME_ANGLE,
    SAME_SHIFT,
    as_moves,
    distinct,
    joined,
    products,
    same_axes,
    same_planes,
)
from training.oracle.rotation_order import turn_of
from training.oracle.starts import extents, hemisphere, locally_best
from training.oracle.truth import CLEAR_ERROR, TruthAxis

MAX_ERROR = 4e-4
_LOOK_ALIKE = np.deg2rad(5.0), 0.02
"""An approximate element this close to a better one is its shadow."""
_HOPELESS = 8e-3
"""A start that is worse than this after the closed-form steps is given up."""
_LEAST_TURN = np.deg2rad(4.0)
TILT = np.deg2rad(10.0)
CONTRAST = 2.0
"""An element is a minimum of its own if tilting it by 10 degrees at least doubles the error."""


@dataclass(frozen=True, slots=True)
class Settings:
    """How thorough the search is: numbers of starts and of surface samples."""

    plane_starts: int = 360
    axis_starts: int = 260
    start_orders: tuple[int, ...] = (2, 3, 4, 5)
    """Axes are started with rotations by 2π over these."""
    scan_samples: int = 64
    coarse_samples: int = 128
    order_samples: int = 160
    fine_samples: int = 600
    judge_samples: int = 3000
    closed_steps: int = 8
    rounds: int = 4
    """Products of what is found are tried this often at most."""


class Search:
    """The search of one shape: `run` leaves what it found in ``planes``, ``plane_errors`` and ``axes``."""

    def __init__(self, vertices: FloatArray, faces: IntArray, settings: Settings) -> None:
        def samples(count: int, seed: int) -> FloatArray:
            return np.random.default_rng(seed).permutation(sample_surface(vertices, faces, count, seed)[0])

        self.settings = settings
        self.surface = Surface(vertices, faces)
        self._scan = samples(settings.scan_samples, 201)
        self._coarse = samples(settings.coarse_samples, 202)
        self._order = samples(settings.order_samples, 203)
        self._fine = samples(settings.fine_samples, 204)
        self._judge = samples(settings.judge_samples, 205)
        self._inertia = inertia_frame(vertices, faces)[0]
        self._used = vertices[np.unique(faces)]
        self.planes: FloatArray = np.zeros((0, 4))
        self.plane_errors: FloatArray = np.zeros(0)
        self.continuous: BoolArray = np.zeros(0, dtype=bool)
        self.axes: list[TruthAxis] = []

    def run(self) -> None:
        """Search planes, axes, and products of them."""
        normals = np.vstack([self._inertia, hemisphere(self.settings.plane_starts)])
        low, high, centre = extents(self._used, normals)
        self._add_planes(self._plane_starts(normals, low, high, centre))
        self._add_axes(self._axis_starts(centre))
        self._fold()
        tried_planes, tried_axes = np.zeros((0, 4)), Axes(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 1)), True)
        for _ in range(self.settings.rounds):
            rows, axes = products(self.planes, self.axes)
            rows = np.vstack([rows, *(np.append(axis.direction, 0.0) for axis in self.axes)])
            rows = rows[~same_planes(rows, np.vstack([self.planes, tried_planes])).any(1)]
            rows = rows[distinct(same_planes(rows, rows), np.zeros(len(rows)))]
            known = same_axes(axes, joined(tried_axes, as_moves(self.axes)))
            axes = axes.take(np.flatnonzero(~known.any(axis=1)).astype(np.int32))
            axes = axes.take(distinct(same_axes(axes, axes), np.zeros(len(axes))))
            if not len(rows) and not len(axes):
                break
            tried_planes, tried_axes = np.vstack([tried_planes, rows]), joined(tried_axes, axes)
            self._add_planes(Planes(rows))
            self._add_axes(axes)
            self._fold()
        kept = ~surplus_planes(self.axes, self.planes, self.plane_errors) | self.continuous
        self.planes, self.plane_errors, self.continuous = (
            self.planes[kept],
            self.plane_errors[kept],
            self.continuous[kept],
        )
        too_many = surplus_axes(self.axes)
        self.axes = [axis for axis, extra in zip(self.axes, too_many, strict=True) if not extra]

    def plane_errors_of(self, rows: FloatArray) -> FloatArray:
        """Errors of planes ``(k, 4)`` on the samples that judge, ``(k,)``."""
        return np.array([float(self.surface.errors(Planes(row[None]).images(self._judge))[0]) for row in rows])

    def axis_error(self, direction: FloatArray, point: FloatArray, order: int | None) -> float:
        """Error of an axis: of a rotation by 2π/``order``, or over all angles."""
        rotation = Axes(direction[None], point[None], self._angles(order, len(self._judge), single=True))
        return float(self.surface.errors(rotation.images(self._judge))[0])

    def _plane_starts(self, normals: FloatArray, low: FloatArray, high: FloatArray, centre: FloatArray) -> Planes:
        """The most promising offsets of every direction, moved a few closed-form steps."""
        middle = np.median(normals @ self._coarse.T, axis=1)
        offsets = -np.stack([np.zeros(len(normals)), (low + high) / 2.0, normals @ centre, middle], axis=1)
        fresh = np.ones(offsets.shape, dtype=bool)
        for column in range(1, offsets.shape[1]):
            apart = np.abs(offsets[:, :column] - offsets[:, column : column + 1])
            fresh[:, column] = ~((apart < SAME_SHIFT) & fresh[:, :column]).any(1)
        owners, columns = np.nonzero(fresh)
        starts = Planes(np.column_stack([normals[owners], offsets[owners, columns]]))
        errors = self.surface.errors(starts.images(self._scan))
        best = np.full(len(normals), np.inf)
        np.minimum.at(best, owners, errors)
        moves = starts.take(errors <= 1.5 * best[owners])
        for step in range(self.settings.closed_steps):
            moves = moves.icp_step(self._coarse if step > 3 else self._scan, self.surface)
            if step % 2:
                moves = moves.take(distinct(same_planes(moves.rows, moves.rows), np.zeros(len(moves))))
            if step == 3:
                moves = moves.take(self.surface.errors(moves.images(self._scan)) <= _HOPELESS)
        return moves

    def _axis_starts(self, centre: FloatArray) -> Axes:
        """For every start order the directions better than their neighbours, moved a few closed-form steps."""
        directions = np.vstack([self._inertia, hemisphere(self.settings.axis_starts)])
        points = [np.zeros(3)] if np.linalg.norm(centre) < SAME_SHIFT else [np.zeros(3), centre]
        chosen: list[Axes] = []
        for order in self.settings.start_orders:
            angles = np.full((len(directions), 1), 2.0 * np.pi / order)
            several = [Axes(directions, np.tile(point, (len(directions), 1)), angles, True) for point in points]
            errors = np.stack([self.surface.errors(axes.images(self._scan)) for axes in several])
            for axes, own in zip(several, errors, strict=True):
                chosen.append(axes.take(locally_best(directions, own) & (own <= 1.5 * errors.min(0))))
        moves = joined(*chosen)
        for step in range(self.settings.closed_steps):
            moves = moves.icp_step(self._coarse if step > 3 else self._scan, self.surface)
            if step % 2:
                same = same_axes(moves, moves) & (np.abs(moves.angles - moves.angles.T) < 3.0 * SAME_ANGLE)
                moves = moves.take(distinct(same, np.zeros(len(moves))))
        return moves.take(moves.angles[:, 0] > _LEAST_TURN)

    def _add_planes(self, moves: Planes) -> None:
        """Fit candidates to convergence and keep those that hold and are minima of their own."""

        def same(batch: Planes) -> BoolArray:
            return same_planes(batch.rows, batch.rows)

        rows = self._fitted(moves, same).rows
        errors = self.plane_errors_of(rows)
        good = [error <= MAX_ERROR and self._plane_contrast(row) for row, error in zip(rows, errors, strict=True)]
        rows, errors = np.vstack([self.planes, rows[good]]), np.append(self.plane_errors, errors[good])
        close = same_planes(rows, rows) | (same_planes(rows, rows, *_LOOK_ALIKE) & (errors >= CLEAR_ERROR))
        kept = distinct(close, errors)
        self.planes, self.plane_errors = rows[kept], errors[kept]

    def _add_axes(self, moves: Axes) -> None:
        """The same for axes."""

        def same(batch: Axes) -> BoolArray:
            return same_axes(batch, batch)

        moves = self._fitted(moves, same)
        found = list(self.axes)
        for direction, point in zip(moves.directions, moves.points, strict=True):
            if sphere_centre(found) is not None:
                break
            if self._in_a_family(direction, point, found):
                continue
            axis = self._finished(direction, point)
            if axis is not None:
                found.append(axis)
        errors = np.array([axis.error for axis in found])
        lines = as_moves(found)
        close = same_axes(lines, lines) | (same_axes(lines, lines, *_LOOK_ALIKE) & (errors >= CLEAR_ERROR))
        self.axes = [found[index] for index in distinct(close, errors)]

    def _in_a_family(self, direction: FloatArray, point: FloatArray, found: list[TruthAxis]) -> bool:
        """Whether an axis crosses a continuous one, as others do that are only two-fold: it need not be looked at."""
        here = TruthAxis(direction, point, 2, 0.0)
        for axis in found:
            if axis.order is None and axis.error < 0.1 * CLEAR_ERROR and across(axis, here):
                return any(other.order == 2 and across(axis, other) for other in found)
        return False

    def _fold(self) -> None:
        """Replace the members of continuous families by what stands for them."""
        self.continuous = np.zeros(len(self.planes), dtype=bool)
        centre = sphere_centre(self.axes)
        if centre is not None:
            frame = self._inertia
            self.planes = np.column_stack([frame, -frame @ centre])
            self.plane_errors = self.plane_errors_of(self.planes)
            self.continuous = np.ones(3, dtype=bool)
            self.axes = [TruthAxis(row, centre, None, self.axis_error(row, centre, None)) for row in frame]
            return
        for axis in [axis for axis in self.axes if axis.order is None]:
            rows = family_planes(axis, self.planes, self.plane_errors)
            errors = self.plane_errors_of(rows)
            member = of_family(axis, planes_through(axis, self.planes), self.plane_errors)
            held = errors <= MAX_ERROR
            self.planes = np.vstack([self.planes[~member], rows[held]])
            self.plane_errors = np.append(self.plane_errors[~member], errors[held])
            self.continuous = np.append(self.continuous[~member], np.ones(int(held.sum()), dtype=bool))
            crossing = np.array([other.order == 2 and across(axis, other) for other in self.axes], dtype=bool)
            folded = of_family(axis, crossing, np.array([other.error for other in self.axes]))
            self.axes = [other for other, gone in zip(self.axes, folded, strict=True) if not gone]

    def _fitted(self, moves: Candidates, same: Callable[[Candidates], BoolArray]) -> Candidates:
        """Distinct candidates, fitted in stages: few samples and a generous limit first, to convergence last."""
        errors = self.surface.errors(moves.images(self._scan)) if len(moves) else np.zeros(0)
        for samples, steps, limit, most in (
            (self._scan, 0, _HOPELESS, 400),
            (self._coarse, 4, 2e-3, 160),
            (self._coarse, 8, 8e-4, 64),
            (self._fine[::4], 8, 6e-4, 40),
            (self._fine, 20, 1.25 * MAX_ERROR, 32),
        ):
            if not len(moves):
                break
            if steps:
                moves, errors = polish(moves, samples, self.surface, steps)
                moves, errors = _turning(moves, errors)
            kept = distinct(same(moves), errors)
            kept = kept[errors[kept] <= limit][:most]
            moves, errors = moves.take(kept), errors[kept]
        return moves

    def _finished(self, direction: FloatArray, point: FloatArray) -> TruthAxis | None:
        """The order of a candidate axis, its last refinement over all its rotations, and its error."""
        found = turn_of(direction, point, self._order, self._fine, self.surface, 1.25 * MAX_ERROR)
        if found is None:
            return None
        start = Axes(direction[None], point[None], self._angles(found.order, len(self._fine)))
        moves, _ = polish(start, self._fine, self.surface, 25)
        direction, point = moves.directions[0], moves.points[0]
        error = self.axis_error(direction, point, found.order)
        if error > MAX_ERROR:
            return None
        # On a sphere every axis is as good as any other.
        if not (found.order is None and error < CLEAR_ERROR) and not self._axis_contrast(direction, point, found.order):
            return None
        return TruthAxis(direction, point, found.order, error)

    def _angles(self, order: int | None, count: int, single: bool = False) -> FloatArray:
        """An angle for every sample ``(1, count)``, over all rotations; ``(1, 1)`` if ``single`` and finite."""
        if order is None:
            return 2.0 * np.pi * np.array([(index * 0.6180339887498949) % 1.0 for index in range(count)])[None]
        if single:
            return np.array([[2.0 * np.pi / order]])
        return np.array([2.0 * np.pi / order * (1 + index % (order - 1)) for index in range(count)])[None]

    def _plane_contrast(self, row: FloatArray) -> bool:
        """Whether a plane is a minimum of its own: each tilt by 10 degrees at least doubles the error."""
        around = Planes(np.vstack([row, np.column_stack([tilted(row[:3], TILT), np.full(8, row[3])])]))
        error, *others = self.surface.errors(around.images(self._order))
        return min(others) >= CONTRAST * error

    def _axis_contrast(self, direction: FloatArray, point: FloatArray, order: int | None) -> bool:
        """The same for an axis."""
        angles = np.tile(self._angles(order, len(self._order), single=True), (9, 1))
        around = Axes(np.vstack([direction, tilted(direction, TILT)]), np.tile(point, (9, 1)), angles)
        error, *others = self.surface.errors(around.images(self._order))
        return min(others) >= CONTRAST * error


def _turning(moves: Candidates, errors: FloatArray) -> tuple[Candidates, FloatArray]:
    """Candidates whose angle has not shrunk to nothing, which holds on any shape."""
    if isinstance(moves, Planes):
        return moves, errors
    kept = np.cos(moves.angles[:, 0]) < np.cos(_LEAST_TURN)
    return moves.take(kept), errors[kept]
