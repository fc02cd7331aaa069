"""Martinet, Soler, Holzschuch and Sillion 2006: accurate detection of symmetries with generalised moments.

The moment of order 2p is a function of a direction w, the integral of |s x w|^(2p) over the surface points s. Every
symmetry of the shape is one of every moment, and the axis of one (a plane's normal) is where all their gradients
vanish. Of a finite number of orders this is necessary only; what the moments leave is tested on the shape.

|s x w|^2 = |s|^2 - (s.w)^2 makes a moment a polynomial in w, exact once the integrals of |s|^(2j) times the monomials
of s are known. Those come from Gauss quadrature on every triangle, of full degree where the triangle is large. Orders
are 2 to 12, and the symmetry of a moment about an axis is tested on directions: a half-turn does to an even function
what the reflection does. The paper expands in spherical harmonics, which are the same polynomials in another basis.
"""

from functools import lru_cache
from math import comb, factorial

import numpy as np
from scipy.optimize import least_squares

from model.geometry.frames import triangle_areas
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.geometry.transforms import reflect
from model.types import AnyArray, FloatArray, IntArray
from training.baselines._directions import distinct_lines, fibonacci_hemisphere, local_maxima

TITLE = "Martinet 2006"

HALF_ORDERS = 6
"""Moments of order 2, 4, ..., twice this."""

MOMENT_TOLERANCE = 1e-3
"""A moment is symmetric about an axis when a half-turn changes it by less than this share of its variation."""

SHAPE_TOLERANCE = 4e-4
"""Mean squared distance, unit frame, within which the shape must map to itself; where no candidate does, the best one
is returned all the same."""

MOST = 24
_DIRECTIONS, _NEIGHBOURHOOD = 1200, 0.11
_CONSTANT = 1e-7
"""A moment that varies by less than this share of its mean says nothing: gradients vanish everywhere."""

_ROUND, _MOST_ROUND = 0.02, 3
_SAME_AXIS = np.deg2rad(1.0)
_SAMPLES = 600


def find_planes(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> FloatArray:
    """`training.baselines.Baseline`."""
    moments = Moments(vertices, faces)
    if not moments.telling:
        axes = np.eye(3)
    else:
        grid = fibonacci_hemisphere(_DIRECTIONS)
        starts = grid[local_maxima(grid, -np.square(moments.gradients(grid)).sum(1), _NEIGHBOURHOOD)]
        axes = np.array([moments.stationary(start) for start in starts])
        around = [moments.stationary(start) for axis in moments.round_about(axes) for start in _across(axis)]
        axes = np.concatenate([axes, np.reshape(around, (-1, 3))])
    asymmetry = moments.asymmetries(axes)
    order = np.argsort(asymmetry, kind="stable")
    order = order[distinct_lines(axes[order], _SAME_AXIS)]
    candidates = [row for row in order if asymmetry[row] <= MOMENT_TOLERANCE][:MOST] or list(order[:1])
    planes = np.column_stack([axes[candidates], np.zeros(len(candidates))])
    surface = SurfaceIndex(vertices, faces)
    samples, _ = sample_surface(vertices, faces, _SAMPLES, seed=int(rng.integers(2**32)))
    errors = np.array([surface.mean_squared_distance(reflect(samples, plane)) for plane in planes])
    best = np.argsort(errors, kind="stable")
    return planes[best[: max(1, int((errors <= SHAPE_TOLERANCE).sum()))]]


class Moments:
    """The even generalised moments of a surface as functions of a direction, each divided by its variation."""

    def __init__(self, vertices: FloatArray, faces: IntArray) -> None:
        """From ``(v, 3)`` of the unit frame and ``(f, 3)``."""
        points, weights = _quadrature(vertices, faces)
        radii = np.square(points).sum(1)
        exponents = _exponents()
        monomials = [_monomials(points, part) for part in exponents]
        self._coefficients: list[list[FloatArray]] = []
        for p in range(1, HALF_ORDERS + 1):
            parts: list[FloatArray] = []
            for k in range(p + 1):
                multinomial = np.array(
                    [factorial(2 * k) / np.prod([factorial(e) for e in row]) for row in exponents[k]]
                )
                integral = (weights * radii ** (p - k)) @ monomials[k]
                parts.append((-1.0) ** k * comb(p, k) * multinomial * integral)
            self._coefficients.append(parts)
        test = fibonacci_hemisphere(_DIRECTIONS)
        values = self.values(test)
        self._scales = values.std(0)
        self.telling = [p for p in range(HALF_ORDERS) if self._scales[p] > _CONSTANT * values[:, p].mean()]
        """Which moments are not constant."""

    def values(self, directions: FloatArray) -> FloatArray:
        """All moments ``(n, P)`` of directions ``(n, 3)``, as they are."""
        terms = [_monomials(directions, part) for part in _exponents()]
        return np.column_stack([sum(terms[k] @ part for k, part in enumerate(parts)) for parts in self._coefficients])

    def gradients(self, directions: FloatArray) -> FloatArray:
        """Tangential gradients ``(n, 3 * telling)`` of the moments that are not constant, by their variation."""
        derivatives = [[_monomials(directions, part, axis) for axis in range(3)] for part in _exponents()]
        columns: list[FloatArray] = []
        for p in self.telling:
            parts = self._coefficients[p]
            gradient = np.stack(
                [sum(derivatives[k][axis] @ part for k, part in enumerate(parts)) for axis in range(3)], axis=1
            )
            along = np.einsum("ni,ni->n", gradient, directions)[:, None] * directions
            columns.append((gradient - along) / self._scales[p])
        return np.concatenate(columns, axis=1)

    def round_about(self, axes: FloatArray) -> FloatArray:
        """Those of ``axes`` ``(k, 3)`` across which the moment of order 2, the inertia, hardly varies.

        There only small gradients of higher orders tell one direction from the next, and the valley has no minimum on
        a grid that does not follow it.
        """
        axes = axes[distinct_lines(axes, _SAME_AXIS)]
        variation = np.array([self.values(_across(axis))[:, 0].std() for axis in axes])
        return axes[variation <= _ROUND * self._scales[0]][:_MOST_ROUND]

    def stationary(self, start: FloatArray) -> FloatArray:
        """The direction near ``start`` where the gradients are smallest: ``(3,)``, unit."""

        def residuals(direction: AnyArray) -> AnyArray:
            return self.gradients((direction / np.linalg.norm(direction))[None])[0]

        basis = np.linalg.svd(start[None])[2][1:]
        found = least_squares(
            lambda at: residuals(start + at @ basis), np.zeros(2), method="lm", xtol=1e-12, ftol=1e-14
        )
        direction = start + found.x @ basis
        return direction / np.linalg.norm(direction)

    def asymmetries(self, axes: FloatArray) -> FloatArray:
        """The largest change ``(k,)`` of any moment by a half-turn about ``axes`` ``(k, 3)``, root-mean-square."""
        if not self.telling:
            return np.zeros(len(axes))
        test = fibonacci_hemisphere(_DIRECTIONS // 4)
        before = self.values(test)
        changes: list[float] = []
        for axis in axes:
            after = self.values(2.0 * (test @ axis)[:, None] * axis - test)
            change = np.sqrt(np.square(after - before).mean(0)) / self._scales.clip(1e-300)
            changes.append(float(change[self.telling].max()))
        return np.array(changes)


def _across(axis: FloatArray) -> FloatArray:
    """Directions ``(18, 3)``, ten degrees apart, at a right angle to an axis."""
    angles = np.deg2rad(np.arange(0.0, 180.0, 10.0))
    first, second = np.linalg.svd(axis[None])[2][1:]
    return np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second


@lru_cache(maxsize=1)
def _exponents() -> list[AnyArray]:
    """Exponents ``(m, 3)`` of the monomials of degree 0, 2, ..., 2 P."""
    return [
        np.array([(a, b, 2 * k - a - b) for a in range(2 * k + 1) for b in range(2 * k + 1 - a)])
        for k in range(HALF_ORDERS + 1)
    ]


def _monomials(points: FloatArray, exponents: AnyArray, derivative: int | None = None) -> FloatArray:
    """Monomials ``(n, m)`` of points ``(n, 3)``, or their derivatives by one coordinate."""
    factor = np.ones(len(exponents))
    if derivative is not None:
        factor = exponents[:, derivative].astype(np.float64)
        exponents = exponents.copy()
        exponents[:, derivative] = np.maximum(exponents[:, derivative] - 1, 0)
    powers = [points[:, axis : axis + 1] ** np.arange(2 * HALF_ORDERS + 1) for axis in range(3)]
    product = powers[0][:, exponents[:, 0]]
    for axis in (1, 2):
        product = product * powers[axis][:, exponents[:, axis]]
    return product * factor


_RULES = ((0.02, 1), (0.06, 2), (0.2, 4), (np.inf, HALF_ORDERS + 1))
"""Triangles with edges up to so long, unit frame, get so many nodes a side; the last is exact for all orders."""


def _quadrature(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, FloatArray]:
    """Points ``(n, 3)`` on the surface and weights ``(n,)`` that sum to one."""
    corners = vertices[faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(1)
    areas = triangle_areas(corners)
    points: list[FloatArray] = []
    weights: list[FloatArray] = []
    least = 0.0
    for most, nodes in _RULES:
        chosen = (longest >= least) & (longest < most)
        least = most
        barycentric, share = _rule(nodes)
        points.append(np.einsum("qc,fci->fqi", barycentric, corners[chosen]).reshape(-1, 3))
        weights.append((areas[chosen, None] * share).ravel())
    total = np.concatenate(weights)
    return np.concatenate(points), total / total.sum()


@lru_cache(maxsize=8)
def _rule(nodes: int) -> tuple[FloatArray, FloatArray]:
    """Barycentric coordinates ``(q, 3)`` and weights ``(q,)`` that sum to one: Gauss nodes of a square, collapsed."""
    at, weight = np.polynomial.legendre.leggauss(nodes)
    at, weight = (at + 1.0) / 2.0, weight / 2.0
    u, v = np.meshgrid(at, at, indexing="ij")
    share = np.outer(weight * 2.0 * (1.0 - at), weight).ravel()
    first, second = u.ravel(), ((1.0 - u) * v).ravel()
    return np.column_stack([first, second, 1.0 - first - second]), share
