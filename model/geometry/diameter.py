"""The diameter of a point set: the largest distance of two of its points."""

import numpy as np

from model.geometry.scan import directions
from model.types import FloatArray

_BLOCK = 200_000
_PAIRWISE = 3000
"""So many points are compared with each other; of more, those that are extreme in some direction start a climb."""

_CLIMBS = 24


def diameter(points: FloatArray) -> float:
    """The largest distance of two of the points ``(n, 3)``, ``n`` at least 1.

    Exact where few points can be an end of the longest line, as in all but nearly round shapes. Otherwise each end of
    the widest directions moves on to what is farthest from it until neither moves: at least 0.99 of the diameter for
    certain, and in practice the diameter.
    """
    points = np.unique(points, axis=0)
    ways = directions()
    low, high = np.full(len(ways), np.inf), np.full(len(ways), -np.inf)
    ends = np.zeros(len(ways), dtype=np.intp)
    for begin in range(0, len(points), block := max(1, _BLOCK // len(ways) * 8)):
        heights = points[begin : begin + block] @ ways.T
        highest = heights.max(axis=0)
        better = highest > high
        ends[better] = begin + heights.argmax(axis=0)[better]
        high, low = np.maximum(high, highest), np.minimum(low, heights.min(axis=0))
    widest = np.argsort(low - high)[:_CLIMBS]
    best = max(_climb(points, int(ends[way])) for way in widest)
    center = (points.min(axis=0) + points.max(axis=0)) / 2.0
    radii = np.linalg.norm(points - center, axis=1)
    far = points[radii + radii.max() >= best]
    if len(far) <= _PAIRWISE:
        best = max([best, *(float(np.linalg.norm(far - point, axis=1).max()) for point in far)])
    return best


def _climb(points: FloatArray, end: int) -> float:
    best = -1.0
    while True:
        lengths = np.linalg.norm(points - points[end], axis=1)
        end = int(lengths.argmax())
        if not lengths[end] > best:
            return best
        best = float(lengths[end])
