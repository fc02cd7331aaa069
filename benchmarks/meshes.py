"""Surfaces of any size for the benchmarks: a displaced icosphere, triangles of many sizes, no symmetry."""

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
