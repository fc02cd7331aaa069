"""Korman, Litman, Avidan and Bronstein 2015: probably approximately symmetric.

The shape is a truncated distance transform f on a grid; the distortion of a transformation T is the mean of |f(x) -
f(T x)|, estimated from so many random points as its accuracy needs, whatever the size of the grid. The
transformations, here the reflections in planes through the centroid, are covered by a net so fine that some member
comes close to each of them; a bound on how much the distortion changes within a cell rejects whole cells (branch and
bound), the others are divided, and the best symmetry is found to within the chosen precision with high probability.
Others are found in the same way outside the neighbourhood of those already found.

The paper takes rotations and reflections; planes are asked for here. Distortions are reported up to `MOST_DISTORTION`:
where a shape has none, nothing is returned.
"""

import numpy as np

from model.types import AnyArray, FloatArray, IntArray
from training.baselines._directions import fibonacci_hemisphere, local_minimum
from training.baselines._volume import Volume, distance_volume

TITLE = "Korman 2015"

RESOLUTION = 64
TRUNCATION = 0.12
"""Distances, unit frame, beyond which the function is constant: it sets the function's total variation."""

POINTS = 1000
"""The mean of so many values between 0 and 1 is off by more than 0.05 once in a hundred (Hoeffding's inequality)."""

MOST_DISTORTION = 0.15
PRECISION = np.deg2rad(0.4)
_COARSEST = 250
_SLACK = 0.25
"""Share of the worst-case bound that is used: f rarely changes by its steepest slope everywhere at once."""

_MOST_CELLS = 150
_APART = np.deg2rad(12.0)
_MARGIN = 1.3


def find_planes(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> FloatArray:
    """`training.baselines.Baseline`."""
    distances = distance_volume(vertices, faces, RESOLUTION, _MARGIN * 0.5)
    volume = Volume(1.0 - np.minimum(distances.values / TRUNCATION, 1.0), distances.half)
    points = _points(volume, rng)
    net, spacing = fibonacci_hemisphere(_COARSEST), float(np.sqrt(2.0 * np.pi / _COARSEST))
    values = _distortions(volume, points, net)
    while spacing > PRECISION:
        slack = _SLACK * _bound(points, spacing)
        # A cell survives for the sake of the least distortion in its neighbourhood, if that may come low enough.
        lowest = local_minimum(net, values, _APART)
        kept = (values <= lowest + slack) & (values <= MOST_DISTORTION + slack)
        spacing /= 2.0
        # On a surface of revolution whole bands of planes survive, on a sphere all: the best stand for them.
        best = np.flatnonzero(kept)[np.argsort(values[kept], kind="stable")][:_MOST_CELLS]
        net = _divided(net[np.sort(best)], spacing)
        if not len(net):
            return np.zeros((0, 4))
        values = _distortions(volume, points, net)
    best = np.flatnonzero((values <= local_minimum(net, values, _APART)) & (values <= MOST_DISTORTION))
    best = best[np.argsort(values[best], kind="stable")]
    return np.column_stack([net[best], np.zeros(len(best))])


def _points(volume: Volume, rng: np.random.Generator) -> FloatArray:
    """Random points where the function is not zero: elsewhere both values are, nearly always."""
    inside = volume.centres()[np.flatnonzero(volume.values.ravel() > 0)]
    points = inside[rng.integers(len(inside), size=POINTS)]
    return points + (rng.random(points.shape) - 0.5) * volume.voxel


def _distortions(volume: Volume, points: FloatArray, normals: FloatArray) -> AnyArray:
    """The distortion ``(k,)`` of the reflections in the planes through the origin with ``normals`` ``(k, 3)``."""
    before = volume.at(points)
    images = points - 2.0 * (points @ normals.T).T[:, :, None] * normals[:, None, :]
    return np.abs(volume.at(images) - before).mean(1)


def _bound(points: FloatArray, spacing: float) -> float:
    """How much the distortion can change within a cell: an image moves by twice its radius times the angle."""
    radius = np.linalg.norm(points, axis=1)
    return float(np.minimum(2.0 * radius * spacing / TRUNCATION, 1.0).mean())


def _divided(normals: FloatArray, spacing: float) -> FloatArray:
    """Every normal and eight around it, ``spacing`` apart; what has come to lie close to another is left out."""
    first = np.cross(normals, np.eye(3)[np.abs(normals).argmin(1)])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normals, first)
    steps = [(a, b) for a in (0.0, -1.0, 1.0) for b in (0.0, -1.0, 1.0)]
    cells = np.concatenate([normals + spacing * (a * first + b * second) for a, b in steps])
    cells /= np.linalg.norm(cells, axis=1, keepdims=True)
    cells *= np.where(cells[:, 2:] < 0, -1.0, 1.0)
    _, rows = np.unique(np.round(cells / (0.6 * spacing)), axis=0, return_index=True)
    return cells[np.sort(rows)]
