"""Podolak, Shilane, Golovinskiy, Rusinkiewicz and Funkhouser 2006: the planar reflective symmetry transform (PRST).

Every pair of surface points votes for the one plane that reflects one to the other. A vote counts 1 / (2 d^2 sin
theta), d the distance of the points and theta the polar angle of the plane's normal: so much space of pairs lies in a
cell of the space of planes. Cells are 64 x 64 x 64 in theta, phi and r. Local maxima are then refined as the paper
does: sample points are reflected, paired with the closest points of the surface, and the plane that fits the pairs
best is next, until it stays.
"""

from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter

from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.geometry.transforms import reflect
from model.types import AnyArray, FloatArray, IntArray

TITLE = "PRST"

CELLS = 64
POINTS, PAIRS = 20_000, 2_000_000
MAXIMA = 40
"""At most so many are refined, ..."""

LEAST = 0.05
"""... of those with so large a share of the most votes."""

CLOSEST = 1.0 / 32.0
"""Pairs nearer than this (unit frame) are left out: they vote for the tangent planes, the more the nearer they are. But
the plane half-way through a washer has no other votes than those of pairs as near as the washer is thick."""

_BLUR = 1.0
_EDGES: Any = ("nearest", "wrap", "nearest")  # scipy's stubs know one mode for all axes only
_STEPS, _SAMPLES, _STILL = 30, 600, 1e-6
_SAME_ANGLE, _SAME_OFFSET = np.deg2rad(2.0), 0.01


def find_planes(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> FloatArray:
    """`training.baselines.Baseline`."""
    points, _ = sample_surface(vertices, faces, POINTS, seed=int(rng.integers(2**32)))
    return maxima_of_votes(points, vertices, faces, rng, CLOSEST)


def maxima_of_votes(
    points: FloatArray, vertices: FloatArray, faces: IntArray, rng: np.random.Generator, least_distance: float
) -> FloatArray:
    """The transform's maxima ``(k, 4)``, refined, most votes first.

    Args:
        points: ``(n, 3)``; random pairs of them vote.
        vertices: ``(v, 3)`` of the surface, unit frame.
        faces: ``(f, 3)``.
        rng: draws the pairs.
        least_distance: unit frame, of a pair that votes.
    """
    first, second = points[rng.integers(len(points), size=(2, PAIRS))]
    planes, weights = _votes(first, second, least_distance)
    surface = SurfaceIndex(vertices, faces)
    samples, _ = sample_surface(vertices, faces, _SAMPLES, seed=int(rng.integers(2**32)))
    kept: list[FloatArray] = []
    for start in _peaks(_histogram(planes, weights)):
        plane = _refined(surface, samples, start)
        if not any(_same(plane, other) for other in kept):
            kept.append(plane)
    return np.array(kept).reshape(-1, 4)


def _votes(first: FloatArray, second: FloatArray, least_distance: float) -> tuple[FloatArray, FloatArray]:
    """The planes (n, d) ``(k, 4)`` that reflect points to points, n in the upper hemisphere, and their weights."""
    across = second - first
    distance = np.linalg.norm(across, axis=1)
    far = distance > least_distance
    across, distance = across[far], distance[far]
    normals = across / distance[:, None]
    normals *= np.where(normals[:, 2:] < 0, -1.0, 1.0)
    offsets = -np.einsum("ki,ki->k", normals, (first[far] + second[far]) / 2.0)
    sine = np.sqrt(np.maximum(1.0 - normals[:, 2] ** 2, 0.0))
    return np.column_stack([normals, offsets]), 1.0 / (2.0 * distance**2 * np.maximum(sine, 0.5 / CELLS))


def _histogram(planes: FloatArray, weights: FloatArray) -> AnyArray:
    """Votes by cell ``(theta, phi, r)``: theta to pi / 2, phi around, r from -1/2 to 1/2."""
    theta = np.arccos(np.clip(planes[:, 2], -1.0, 1.0)) * (2.0 / np.pi)
    phi = np.arctan2(planes[:, 1], planes[:, 0]) / (2.0 * np.pi) % 1.0
    places = (np.stack([theta, phi, planes[:, 3] + 0.5]) * CELLS).astype(np.int64)
    places = np.clip(places, 0, CELLS - 1)
    flat = np.ravel_multi_index(tuple(places), (CELLS,) * 3)
    votes = np.bincount(flat, weights, CELLS**3).reshape((CELLS,) * 3)
    # What lies beyond the equator is the plane on the other side with its offset turned.
    beyond = np.roll(votes[::-1, :, ::-1], CELLS // 2, axis=1)
    pole = np.roll(votes[::-1], CELLS // 2, axis=1)
    return gaussian_filter(np.concatenate([pole, votes, beyond]), _BLUR, mode=_EDGES)


def _peaks(wrapped: AnyArray) -> FloatArray:
    """The planes ``(k, 4)`` at the centres of the cells that hold a local maximum, most votes first."""
    highest = maximum_filter(wrapped, size=5, mode=_EDGES)
    votes, highest = wrapped[CELLS : 2 * CELLS], highest[CELLS : 2 * CELLS]
    places = np.argwhere((votes == highest) & (votes >= LEAST * votes.max()))
    values = votes[tuple(places.T)]
    places = places[np.argsort(-values, kind="stable")][:MAXIMA] + 0.5
    theta, phi = places[:, 0] * (np.pi / 2.0 / CELLS), places[:, 1] * (2.0 * np.pi / CELLS)
    sine = np.sin(theta)
    return np.column_stack([sine * np.cos(phi), sine * np.sin(phi), np.cos(theta), places[:, 2] / CELLS - 0.5])


def _refined(surface: SurfaceIndex, samples: FloatArray, plane: FloatArray) -> FloatArray:
    """The plane after steps of pairing every sample with the closest point to its image, and fitting anew."""
    for _ in range(_STEPS):
        closest = surface.closest(reflect(samples, plane))[0]
        middle, other = samples.mean(0), closest.mean(0)
        moments = (samples - middle).T @ (closest - other)
        # Of all planes the one that brings the pairs together: the least eigenvalue of the symmetric part.
        normal = np.linalg.eigh(moments + moments.T)[1][:, 0]
        normal = normal if normal @ plane[:3] >= 0 else -normal
        moved = np.append(normal, -normal @ (middle + other) / 2.0)
        still = np.abs(moved - plane).max() < _STILL
        plane = moved
        if still:
            break
    return plane


def _same(first: FloatArray, second: FloatArray) -> bool:
    cosine = first[:3] @ second[:3]
    offset = abs(first[3] - np.sign(cosine) * second[3])
    return bool(abs(cosine) > np.cos(_SAME_ANGLE) and offset < _SAME_OFFSET)
