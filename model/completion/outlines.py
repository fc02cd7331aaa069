"""Which outlines in a plane overlap: their edges cross, or one lies in the other."""

import itertools

import numpy as np

from model.types import AnyArray, BoolArray, FloatArray

_MOST_PAIRS = 50_000_000
"""Of edges that are looked at in all; what comes after is not known to overlap."""

_ROWS = 1 << 20
"""Pairs of edges that are looked at together."""

_SAMPLES = 64
"""Corners of an outline of which one far enough inside of another is looked for."""

_TOUCHING = 1e-6
"""Share of their size that outlines may be across each other and only touch."""


def overlapping_outlines(planes: list[list[FloatArray]]) -> set[int]:
    """The numbers of the bodies whose outlines overlap that of another one, in any of the planes.

    Args:
        planes: for each plane and body the edges ``(e, 2, 2)`` of its outlines there, ends in any order.
    """
    found: set[int] = set()
    left = _MOST_PAIRS
    for outlines in planes:
        boxes = [_box(outline) for outline in outlines]
        for one, other in itertools.combinations(range(len(outlines)), 2):
            low, high = np.maximum(boxes[one][0], boxes[other][0]), np.minimum(boxes[one][1], boxes[other][1])
            if not (low < high).all() or {one, other} <= found:
                continue
            a, b = (_within(outlines[number], low, high) for number in (one, other))
            left -= len(a) * len(b) + _SAMPLES * (len(outlines[one]) + len(outlines[other]))
            if left < 0:
                return found
            tolerance = _TOUCHING * float(np.max([boxes[number][1] - boxes[number][0] for number in (one, other)]))
            if (
                _cross(a, b, tolerance)
                or _lies_in(outlines[one], outlines[other], tolerance)
                or _lies_in(outlines[other], outlines[one], tolerance)
            ):
                found |= {one, other}
    return found


def _box(edges: FloatArray) -> tuple[FloatArray, FloatArray]:
    corners = edges.reshape(-1, 2) if len(edges) else np.array([[np.inf, np.inf], [-np.inf, -np.inf]])
    return (corners.min(axis=0), corners.max(axis=0)) if len(edges) else (corners[0], corners[1])


def _within(edges: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Edges whose box meets another one."""
    return edges[((edges.min(axis=1) <= high) & (edges.max(axis=1) >= low)).all(axis=1)]


def _cross(ones: FloatArray, others: FloatArray, tolerance: float) -> bool:
    """Whether an edge of one outline passes through one of the other, not only up to it."""
    step = max(1, _ROWS // max(len(others), 1))
    for start in range(0, len(ones), step):
        a, b = ones[start : start + step, None], others[None]
        beside = _beside(a, b, tolerance) & _beside(b, a, tolerance)
        if beside.any():
            return True
    return False


def _beside(lines: AnyArray, edges: AnyArray, tolerance: float) -> BoolArray:
    """Whether the ends of edges are on both sides of the lines through other ones, far enough away."""
    way = lines[..., 1, :] - lines[..., 0, :]
    length = np.maximum(np.linalg.norm(way, axis=-1), 1e-300)
    sides = [
        (way[..., 0] * (edges[..., end, 1] - lines[..., 0, 1]) - way[..., 1] * (edges[..., end, 0] - lines[..., 0, 0]))
        / length
        for end in (0, 1)
    ]
    return (np.minimum(*sides) < -tolerance) & (np.maximum(*sides) > tolerance)


def _lies_in(inner: FloatArray, outer: FloatArray, tolerance: float) -> bool:
    """Whether corners of an outline are inside another one that it does not cross, and not on it."""
    points = inner[:: max(1, len(inner) // _SAMPLES), 0][:_SAMPLES, None]
    a, b = outer[None, :, 0], outer[None, :, 1]
    straddles = (a[..., 1] > points[..., 1]) != (b[..., 1] > points[..., 1])
    rise = np.where(straddles, b[..., 1] - a[..., 1], 1.0)
    at = a[..., 0] + (points[..., 1] - a[..., 1]) / rise * (b[..., 0] - a[..., 0])
    inside = (straddles & (points[..., 0] < at)).sum(axis=1) % 2 == 1
    way = b - a
    share = np.clip(((points - a) * way).sum(axis=-1) / np.maximum((way**2).sum(axis=-1), 1e-300), 0.0, 1.0)
    nearest = np.linalg.norm(a + share[..., None] * way - points, axis=-1).min(axis=1, initial=np.inf)
    return bool((inside & (nearest > tolerance)).any())
