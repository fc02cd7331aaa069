"""Starting candidates of the exhaustive search: directions over the hemisphere, extents and a centre of the shape."""

import numpy as np

from model.types import BoolArray, FloatArray

_CHUNK = 4_000_000


def hemisphere(count: int) -> FloatArray:
    """``(count, 3)`` unit directions spread evenly over a hemisphere (Fibonacci lattice)."""
    index = np.arange(count) + 0.5
    z = index / count
    angle = np.pi * (1.0 + 5.0**0.5) * index
    radius = np.sqrt(1.0 - z * z)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), z])


def extents(points: FloatArray, directions: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """How far ``(v, 3)`` points reach along ``(k, 3)`` directions, and the centre of their smallest ball (nearly).

    Unlike the centroid of the area, both are the same however often a face is repeated.

    Returns:
        the smallest and the largest ``direction · point`` ``(k,)`` each, and the centre ``(3,)``.
    """
    lows, highs, outer = [], [], []
    step = max(1, _CHUNK // len(points))
    for first in range(0, len(directions), step):
        reach = directions[first : first + step] @ points.T
        ends = np.argmin(reach, axis=1), np.argmax(reach, axis=1)
        rows = np.arange(len(reach))
        lows.append(reach[rows, ends[0]])
        highs.append(reach[rows, ends[1]])
        outer += [points[end] for end in ends]
    hull = np.unique(np.concatenate(outer), axis=0)
    # Badoiu and Clarkson, "Smaller core-sets for balls": walk towards the farthest point, in ever smaller steps.
    centre = hull.mean(0)
    for step in range(1, 500):
        centre = centre + (hull[np.argmax(np.square(hull - centre).sum(1))] - centre) / (step + 1.0)
    return np.concatenate(lows), np.concatenate(highs), centre


def locally_best(directions: FloatArray, errors: FloatArray) -> BoolArray:
    """Which of ``(k, 3)`` directions, taken without sign, have a smaller error than all but one of their neighbours."""
    cosines = np.abs(directions @ directions.T)
    np.fill_diagonal(cosines, -1.0)
    neighbours = np.argpartition(-cosines, 6, axis=1)[:, :6]
    return (errors[neighbours] < errors[:, None]).sum(1) <= 1
