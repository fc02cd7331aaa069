"""Directions on the hemisphere, and the extrema of functions of them."""

import numpy as np
from scipy.spatial import KDTree

from model.types import BoolArray, FloatArray


def fibonacci_hemisphere(count: int) -> FloatArray:
    """``(count, 3)`` unit directions, evenly spread over the upper hemisphere."""
    height = (np.arange(count) + 0.5) / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * np.arange(count)
    across = np.sqrt(1.0 - height**2)
    return np.column_stack([across * np.cos(turn), across * np.sin(turn), height])


def local_maxima(directions: FloatArray, values: FloatArray, radius: float) -> BoolArray:
    """Which of ``values`` ``(k,)`` no other value within ``radius`` radians of its line exceeds."""
    return values >= -local_minimum(directions, -values, radius)


def local_minimum(directions: FloatArray, values: FloatArray, radius: float) -> FloatArray:
    """The least of ``values`` ``(k,)`` within ``radius`` radians of each line of ``directions`` ``(k, 3)``."""
    both = np.concatenate([directions, -directions])
    near = KDTree(both).query_ball_point(directions, 2.0 * np.sin(radius / 2.0))
    twice = np.concatenate([values, values])
    return np.array([twice[rows].min() for rows in near])


def fit_maximum(directions: FloatArray, values: FloatArray, row: int, radius: float) -> FloatArray:
    """The maximum of a quadratic through the values about one direction: ``(3,)``, unit.

    The quadratic is fitted by least squares in the tangent plane of ``directions[row]`` to the values within ``radius``
    radians of its line. Where it has no maximum nearby the direction itself is returned.
    """
    centre = directions[row]
    cosine = directions @ centre
    near = np.abs(cosine) >= np.cos(radius)
    local = directions[near] * np.sign(cosine[near])[:, None]
    basis = np.linalg.svd(centre[None])[2][1:]
    u, v = (local @ basis.T / (local @ centre)[:, None]).T
    if len(u) < 6:
        return centre
    terms = np.column_stack([np.ones_like(u), u, v, u * u, u * v, v * v])
    _, b, c, uu, uv, vv = np.linalg.lstsq(terms, values[near], rcond=None)[0]
    hessian = np.array([[2.0 * uu, uv], [uv, 2.0 * vv]])
    if np.linalg.eigvalsh(hessian)[1] >= 0.0:
        return centre
    step = -np.linalg.solve(hessian, [b, c])
    if np.linalg.norm(step) > radius:
        return centre
    moved = centre + step @ basis
    return moved / np.linalg.norm(moved)


def distinct_lines(directions: FloatArray, angle: float) -> list[int]:
    """Rows of ``directions`` ``(k, 3)``, best first, that are farther than ``angle`` radians from every one before."""
    kept: list[int] = []
    for row, direction in enumerate(directions):
        if not kept or np.abs(directions[kept] @ direction).max() <= np.cos(angle):
            kept.append(row)
    return kept
