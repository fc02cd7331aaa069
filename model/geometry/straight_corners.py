"""Corners on straight edges, which ear clipping drops, or makes triangles of that are lines.

Neighbours may end there, so without them there are gaps.
"""

import numpy as np

from model.types import AnyArray, BoolArray, FloatArray

_FLAT = 1e-7
"""Share of the whole area below which a corner is on the edge that passes it."""

_THIN = 1e-6
"""Height of a triangle, as a share of its longest side, below which it is a line."""


def with_straight_corners(flat: FloatArray, triangles: AnyArray, following: AnyArray, area: float) -> AnyArray:
    """Triangles that use all corners of the rings that they cover.

    Args:
        flat: (n, 2) corners.
        triangles: (t, 3) counter-clockwise, over some of them.
        following: (n,) the next corner of each one's ring; the inside is to the left.
        area: of all triangles.
    """
    edges = {(i, j) for a, b, c in triangles.tolist() for i, j in ((a, b), (b, c), (c, a))}
    after: list[int] = following.tolist()
    result: list[tuple[int, int, int]] = []
    waiting: list[tuple[int, int, int]] = [(a, b, c) for a, b, c in triangles.tolist()]
    while waiting:
        triangle = waiting.pop()
        for turn in range(3):
            i, j, tip = (triangle[(turn + step) % 3] for step in range(3))
            middle = after[i]
            known = (j, i) in edges or (i, middle) in edges
            if middle != j and not known and _is_on_edge(flat, i, middle, j, area):
                edges |= {(i, middle), (middle, j), (middle, tip), (tip, middle)}
                waiting += [(i, middle, tip), (middle, j, tip)]
                break
        else:
            result.append(triangle)
    return np.array(result, dtype=np.int64).reshape(-1, 3)


def without_slivers(flat: FloatArray, triangles: AnyArray) -> AnyArray:
    """The same area in as many triangles, of which none is a line as far as that can be.

    Where three corners of a straight edge make a triangle, it and its neighbour are divided along their other diagonal.

    Args:
        flat: (n, 2) corners.
        triangles: (t, 3) counter-clockwise.
    """
    thin = np.flatnonzero(_are_thin(flat, triangles)).tolist()
    if not thin:
        return triangles
    corners: list[list[int]] = triangles.tolist()
    owners = {(t[k], t[(k + 1) % 3]): number for number, t in enumerate(corners) for k in range(3)}
    left = 4 * len(corners)  # neighbours of one line could be exchanged without end
    while thin and left > 0:
        left -= 1
        number = thin.pop()
        sides = [flat[corners[number][(k + 1) % 3]] - flat[corners[number][k]] for k in range(3)]
        longest = int(np.argmax([side @ side for side in sides]))
        c, a, b = (corners[number][(longest + k) % 3] for k in range(3))
        other = owners.get((a, c))
        if other is None or not _are_thin(flat, np.array([corners[number]]))[0]:
            continue
        d = next(corner for corner in corners[other] if corner not in (a, c))
        del owners[a, c], owners[c, a]
        corners[number], corners[other] = [a, b, d], [b, c, d]
        owners |= {(a, b): number, (b, d): number, (d, a): number, (b, c): other, (c, d): other, (d, b): other}
        thin += [both for both in (number, other) if _are_thin(flat, np.array([corners[both]]))[0]]
    return np.array(corners, dtype=np.int64)


def _are_thin(flat: FloatArray, triangles: AnyArray) -> BoolArray:
    """Which triangles have a height of less than a millionth of their longest side."""
    points = flat[triangles]
    longest = ((points - np.roll(points, 1, axis=1)) ** 2).sum(axis=2).max(axis=1)
    return np.asarray(2.0 * np.abs(signed_areas(flat, triangles)) <= _THIN * longest)


def signed_areas(flat: FloatArray, triangles: AnyArray) -> FloatArray:
    """Areas ``(t,)`` of triangles of points ``(n, 2)``, negative where clockwise."""
    a, b, c = flat[triangles[:, 0]], flat[triangles[:, 1]], flat[triangles[:, 2]]
    u, v = b - a, c - a
    return (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2.0


def _is_on_edge(flat: FloatArray, i: int, middle: int, j: int, area: float) -> bool:
    along, to = flat[j] - flat[i], flat[middle] - flat[i]
    off = abs(float(along[0] * to[1] - along[1] * to[0]))
    length = float(along @ along)
    # Of a tongue without width both ends are at one place, and its tip is beyond every edge between them.
    return off <= _FLAT * area and 0.0 <= float(along @ to) <= length and float(to @ to) <= length + _FLAT * area
