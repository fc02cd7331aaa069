"""Surfaces of any size for the benchmarks: a rough sphere, and shapes that are hard in other ways."""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from model.types import FloatArray, IntArray

_SIZES = {"4.5k": 4_500, "200k": 200_000, "1M": 1_000_000}


def sizes() -> dict[str, int]:
    """Names and face counts that all benchmarks use."""
    return dict(_SIZES)


def displaced_sphere(faces: int, seed: int = 0) -> tuple[FloatArray, IntArray]:
    """About ``faces`` triangles within the unit frame's bounding sphere, rough and with ridges.

    A latitude-longitude grid: its triangles are slivers at the poles and regular at the equator.
    """
    rings = int(np.sqrt(faces / 4))
    segments = 2 * rings
    polar, azimuth = np.meshgrid(
        np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, segments, endpoint=False), indexing="ij"
    )
    rng = np.random.default_rng(seed)
    radius = 0.4 * (1 + 0.1 * np.sin(7 * polar + 1) * np.cos(5 * azimuth) + 0.01 * rng.normal(size=polar.shape) / rings)
    points = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)], axis=-1)
    vertices = (radius[..., None] * points).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(rings), np.arange(segments), indexing="ij")
    a, b = i * segments + j, i * segments + (j + 1) % segments
    c, d = a + segments, b + segments
    quads = np.stack([a, c, b, b, c, d], axis=-1).reshape(-1, 3)
    return vertices, quads.astype(np.int32)


def chair(faces: int) -> tuple[FloatArray, IntArray]:
    """Seat, back and four legs with one mirror plane, each a box of finely divided sides."""
    parts = [((1.0, 0.1, 1.0), (0.0, 0.5, 0.0)), ((1.0, 0.8, 0.1), (0.0, 0.95, -0.45))]
    parts += [((0.1, 0.5, 0.1), (x, 0.2, z)) for x in (-0.4, 0.4) for z in (-0.4, 0.4)]
    edge = max(1, round(float(np.sqrt(faces / (len(parts) * 12)))))
    u, v = (grid.ravel() for grid in np.meshgrid(*[np.arange(edge + 1) / edge - 0.5] * 2, indexing="ij"))
    i, j = (grid.ravel() for grid in np.meshgrid(*[np.arange(edge)] * 2, indexing="ij"))
    a, b = i * (edge + 1) + j, (i + 1) * (edge + 1) + j
    side = np.concatenate([np.stack([a, b, b + 1], axis=1), np.stack([a, b + 1, a + 1], axis=1)])
    points, triangles = [], []
    for extents, centre in parts:
        for axis in range(3):
            for sign in (-0.5, 0.5):
                square = np.empty((len(u), 3))
                square[:, axis], square[:, (axis + 1) % 3], square[:, (axis + 2) % 3] = sign, u, v
                triangles.append((side if sign > 0 else side[:, ::-1]) + sum(map(len, points)))
                points.append(square * extents + centre)
    return np.concatenate(points), np.concatenate(triangles).astype(np.int32)


def soup(faces: int, seed: int = 0) -> tuple[FloatArray, IntArray]:
    """Boxes of all sizes in any pose that run through each other."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / 2.0
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    triangles = np.array([row for a, b, c, d in quads for row in ((a, b, c), (a, c, d))])
    rng = np.random.default_rng(seed)
    count = max(1, faces // 12)
    turns = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    sizes = rng.uniform(0.2, 1.0, (count, 1, 3)) * (2.0 / count ** (1 / 3))
    vertices = (corners * sizes) @ turns + rng.uniform(-1.0, 1.0, (count, 1, 3))
    return vertices.reshape(-1, 3), (triangles + 8 * np.arange(count)[:, None, None]).reshape(-1, 3).astype(np.int32)


def slivers(faces: int) -> tuple[FloatArray, IntArray]:
    """A cylinder without lids of some rings of long, thin triangles."""
    rings, segments = 4, max(3, faces // 8)
    angles = 2.0 * np.pi * np.arange(segments) / segments
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    heights = np.linspace(-1.0, 1.0, rings + 1)
    vertices = np.concatenate([np.column_stack([circle, np.full(segments, height)]) for height in heights])
    i, j = np.meshgrid(np.arange(rings), np.arange(segments), indexing="ij")
    a, b = i * segments + j, i * segments + (j + 1) % segments
    quads = np.stack([a, b, b + segments, a, b + segments, a + segments], axis=-1)
    return vertices, quads.reshape(-1, 3).astype(np.int32)


def lattice(faces: int) -> tuple[FloatArray, IntArray]:
    """Small separate squares on a grid through space, turned about it: half as many open pieces as faces."""
    edge = max(1, round((faces / 2) ** (1 / 3)))
    centres = np.stack(np.meshgrid(*[np.arange(edge)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3) / edge
    square = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]) * (0.3 / edge)
    turn = np.linalg.qr(np.array([[1.0, 0.4, 0.0], [0.0, 1.0, 0.3], [0.2, 0.0, 1.0]]))[0]
    vertices = (centres + square @ turn).reshape(-1, 3)
    triangles = np.array([[0, 1, 2], [0, 2, 3]]) + 4 * np.arange(edge**3)[:, None, None]
    return vertices, triangles.reshape(-1, 3).astype(np.int32)


SHAPES: dict[str, Callable[[int], tuple[FloatArray, IntArray]]] = {
    "solid": chair,
    "rough": displaced_sphere,
    "soup": soup,
    "slivers": slivers,
    "lattice": lattice,
}
"""By the benchmark's names, each of about so many faces."""


def milliseconds(action: Callable[[], Any], repeats: int) -> float:
    """CPU milliseconds of the calling process, the best of some runs after one to warm up.

    CPU time rather than the clock: other programs may share the machine.
    """
    action()
    best = np.inf
    for _ in range(repeats):
        start = time.process_time()
        action()
        best = min(best, time.process_time() - start)
    return 1000 * best
