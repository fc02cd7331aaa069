"""Point clouds of extruded plane curves whose planes are known: the shapes of the SHREC 2023 track and of Symmetria.

After the description of the data set in arXiv 2510.23414 (Sipiran et al.), which continues the track: a plane curve
with known symmetries is extruded along z to a tube or, shrinking, to a cone, both open at their ends; points are drawn
uniformly in the parameter of the curve and in the height. Then some are moved by noise or taken away, and the cloud is
turned and moved.

Left out are their shapes of revolution: no list holds all their planes, and a protocol that counts planes off a list
says nothing of them. Everything is drawn anew, nothing is taken from their files.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from model.types import FloatArray
from training.shapes.point_groups import canonical_sign
from training.shapes.solids import random_rotation

Rng = np.random.Generator

POINTS = 6400
"""Of a whole cloud; theirs have 80 x 80."""


@dataclass(frozen=True, slots=True)
class Perturbation:
    """What is done to a cloud; lengths are shares of the diagonal of its bounding box.

    Attributes:
        kept: share of the points, drawn at random, that undersampling leaves.
        uniform: largest noise of a coordinate.
        gaussian: standard deviation of the noise of a coordinate.
    """

    kept: float = 1.0
    uniform: float = 0.0
    gaussian: float = 0.0


PERTURBATIONS = {
    "clean": Perturbation(),
    "uniform": Perturbation(uniform=0.01),
    "gaussian": Perturbation(gaussian=0.005),
    "undersampled": Perturbation(kept=0.25),
    "hard": Perturbation(kept=0.25, gaussian=0.005),
    "severe": Perturbation(kept=0.1, gaussian=0.02),
}
"""By name. The place in this list is part of the seed: new ones come last. How strong noise and undersampling are there
was not found written down; these are ours."""

_CONES = 0.5
"""Share of the clouds that are cones."""


@dataclass(frozen=True, slots=True, eq=False)
class KnownCloud:
    """Points ``(n, 3)``, and the planes ``(k, 4)``, rows (n, d), of the surface they were drawn from."""

    family: str
    is_cone: bool
    points: FloatArray
    planes: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class _Curve:
    """Points ``(n, 2)`` of a curve with ``mirrors`` mirror lines, evenly spaced, one of them the x axis."""

    points: FloatArray
    mirrors: int
    tallest: float = 4.0
    """Height of the highest extrusion, of a curve that reaches to 1."""


def _angles(rng: Rng, count: int) -> FloatArray:
    return rng.uniform(-np.pi, np.pi, count)


def _citrus(rng: Rng, count: int) -> _Curve:
    x = rng.random(count)
    y = rng.uniform(0.8, 2.0) * np.sqrt((1.0 - x) ** 3 * x**3) * rng.choice([-1.0, 1.0], count)
    return _Curve(np.column_stack([x - 0.5, y]), 2)


def _convexities(rng: Rng, count: int) -> _Curve:
    mirrors, depth, angle = int(rng.integers(3, 9)), rng.uniform(0.3, 0.6), _angles(rng, count)
    radius = 1.0 / (1.0 + depth * np.cos(mirrors * angle))
    return _Curve(radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]), mirrors)


def _petals(rng: Rng, count: int) -> _Curve:
    half, depth, angle = int(rng.integers(2, 5)), rng.uniform(0.25, 0.5), _angles(rng, count)
    radius = 1.0 + depth * np.cos(2 * half * angle)
    return _Curve(radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]), 2 * half)


def _lemniscate(rng: Rng, count: int) -> _Curve:
    angle = _angles(rng, count)
    x = np.sin(angle) / (1.0 + np.cos(angle) ** 2)
    return _Curve(np.column_stack([x, x * np.cos(angle)]), 2)


def _egg(rng: Rng, count: int) -> _Curve:
    slope = rng.uniform(-4.0, 4.0, count)
    x = 1.0 / (1.0 + slope**2) ** 2
    return _Curve(np.column_stack([x - 0.5, slope * x]), 1)


def _mouth(rng: Rng, count: int) -> _Curve:
    angle = _angles(rng, count)
    return _Curve(np.column_stack([np.cos(angle), np.sin(angle) ** 3]), 2)


def _astroid(rng: Rng, count: int) -> _Curve:
    angle = _angles(rng, count)
    return _Curve(np.column_stack([np.cos(angle) ** 3, np.sin(angle) ** 3]), 4)


def _square(rng: Rng, count: int) -> _Curve:
    angle = _angles(rng, count)
    round_points = np.column_stack([np.cos(angle), np.sin(angle)])
    return _Curve(round_points / np.abs(round_points).max(1, keepdims=True), 4, 25.0)


def _ellipse(rng: Rng, count: int) -> _Curve:
    angle = _angles(rng, count)
    return _Curve(np.column_stack([np.cos(angle), rng.uniform(0.4, 0.8) * np.sin(angle)]), 2, 25.0)


_CURVES: dict[str, Callable[[Rng, int], _Curve]] = {
    "citrus": _citrus,
    "m_convexities": _convexities,
    "geometric_petal": _petals,
    "lemniscate": _lemniscate,
    "egg_of_keplero": _egg,
    "mouth": _mouth,
    "astroid": _astroid,
    "square": _square,
    "ellipse": _ellipse,
}

FAMILIES: Sequence[str] = tuple(_CURVES)


def draw_cloud(index: int, perturbation: str = "clean", seed: int = 0) -> KnownCloud:
    """A cloud in a random pose; families take turns.

    Args:
        index: of the cloud. Its shape and pose are the same for every perturbation.
        perturbation: one of `PERTURBATIONS`.
        seed: of all that is drawn.

    Raises:
        ValueError: there is no such perturbation.
    """
    if perturbation not in PERTURBATIONS:
        raise ValueError(f"perturbation is one of {', '.join(PERTURBATIONS)}, not {perturbation!r}")
    rng = np.random.default_rng([seed, index])
    family = FAMILIES[index % len(FAMILIES)]
    curve = _CURVES[family](rng, POINTS)
    flat = curve.points / curve.points.max()
    is_cone = bool(rng.random() < _CONES)
    height, level = rng.uniform(0.5, curve.tallest), rng.random(POINTS)
    points = np.column_stack([(level[:, None] if is_cone else 1.0) * flat, height * (level - 0.5)])
    directions = np.pi / 2.0 + np.pi * np.arange(curve.mirrors) / curve.mirrors
    normals = np.column_stack([np.cos(directions), np.sin(directions), np.zeros(curve.mirrors)])
    if not is_cone:
        normals = np.vstack([normals, [0.0, 0.0, 1.0]])
    rotation, translation = random_rotation(rng), rng.normal(size=3)
    points = points @ rotation.T + translation
    normals = np.array([canonical_sign(normal) for normal in normals @ rotation.T])
    planes = np.column_stack([normals, -normals @ translation])
    rng = np.random.default_rng([seed, index, list(PERTURBATIONS).index(perturbation)])
    return KnownCloud(family, is_cone, _perturbed(points, PERTURBATIONS[perturbation], rng), planes)


def _perturbed(points: FloatArray, how: Perturbation, rng: Rng) -> FloatArray:
    diagonal = float(np.linalg.norm(points.max(0) - points.min(0)))
    kept = points[np.sort(rng.permutation(len(points))[: round(how.kept * len(points))])]
    noise = rng.uniform(-how.uniform, how.uniform, kept.shape) + rng.normal(0.0, how.gaussian, kept.shape)
    return kept + diagonal * noise
