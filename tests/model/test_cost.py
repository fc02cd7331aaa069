"""What a detection costs, counted and not timed: calls in Python, nodes of the tree looked into, bytes held at a time.

The limits are about one and a half times what was counted when they were written: a step that costs twice as much is
noticed on every machine, however busy. Whoever makes a step cheaper lowers them.
"""

import sys
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.meshes import SHAPES
from model import Detector, Mesh, read_mesh
from model import detector as module
from model.geometry.surface import WORK, SurfaceIndex
from model.search import context

DATA = Path(__file__).parents[1] / "data"


@pytest.fixture(scope="module")
def detector() -> Detector:
    loaded = Detector.load()
    loaded.warm_up()
    return loaded


@pytest.fixture
def indices(monkeypatch: pytest.MonkeyPatch) -> list[SurfaceIndex]:
    """The distance structures that a detection makes."""
    made: list[SurfaceIndex] = []

    class Watched(SurfaceIndex):
        def __init__(self, *args: Any, **options: Any) -> None:
            super().__init__(*args, **options)
            made.append(self)

    monkeypatch.setattr(module, "SurfaceIndex", Watched)
    return made


def mesh_of(name: str) -> Mesh:
    if name in SHAPES:
        return Mesh.checked(*SHAPES[name](4_500))
    return read_mesh((DATA / name).read_bytes(), name)


def test_a_search_that_is_cut_short_is_judged_and_says_so(detector: Detector, monkeypatch: pytest.MonkeyPatch) -> None:
    chair = mesh_of("chair.obj")
    assert not any("cut short" in warning for warning in detector.detect(chair).warnings)
    monkeypatch.setattr(context, "_LEFT_TO_JUDGE", WORK + 1.0)
    answer = detector.detect(chair)
    assert any("cut short" in warning for warning in answer.warnings)
    assert answer.planes[0].exact
    assert abs(answer.planes[0].normal[0]) > 0.999


@pytest.mark.parametrize(
    ("name", "mode", "calls", "visits", "bytes_held"),
    [
        ("chair.obj", "full", 6_300, 40_000, 850_000),
        ("chair.obj", "paper", 2_100, 38_000, 2_200_000),
        ("stool.3mf", "full", 16_300, 180_000, 1_200_000),
        ("rough", "full", 41_000, 2_350_000, 5_500_000),
        ("rough", "paper", 2_400, 80_000, 2_300_000),
        ("soup", "full", 21_000, 920_000, 8_200_000),
        ("lattice", "paper", 3_000, 80_000, 2_500_000),
    ],
)
def test_a_detection_costs_no_more_than_it_did(
    name: str, mode: Any, calls: int, visits: int, bytes_held: int, detector: Detector, indices: list[SurfaceIndex]
) -> None:
    mesh = mesh_of(name)
    detector.detect(mesh, mode=mode)  # what is kept from one to the next is there
    indices.clear()
    count = 0

    def counted(frame: Any, event: str, argument: Any) -> None:
        nonlocal count
        count += event in ("call", "c_call")

    sys.setprofile(counted)
    try:
        detector.detect(mesh, mode=mode)
    finally:
        sys.setprofile(None)
    visited = sum(WORK - index.work_left for index in indices)
    tracemalloc.start()
    try:
        detector.detect(mesh, mode=mode)
        held = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert len(indices) == 2
    found = {"calls": count, "visits": round(visited), "bytes": held}
    assert 0 < count <= calls, found
    assert 0 < visited <= visits, found
    assert 0 < held <= bytes_held, found


def test_a_large_mesh_is_looked_at_in_part_and_its_corners_are_kept_once(
    detector: Detector, indices: list[SurfaceIndex]
) -> None:
    vertices, faces = SHAPES["solid"](200_000)
    mesh = Mesh.checked(vertices[faces.ravel()], np.arange(faces.size).reshape(-1, 3))
    tracemalloc.start()
    try:
        detector.detect(mesh)
        held = tracemalloc.get_traced_memory()[1] / len(faces)
    finally:
        tracemalloc.stop()
    tree = indices[0].tree
    made = float(tree.taken[1]) / len(tree.frames_of), float(tree.taken[0] - tree.upper) / len(tree.row_of)
    found = {"visits": round(WORK - indices[0].work_left), "frames": made[0], "nodes": made[1], "bytes": held}
    assert 0 < found["visits"] <= 40_000, found
    assert 0 < made[0] <= 0.07, found
    assert 0 < made[1] <= 0.25, found
    assert 0 < held <= 400, found
    assert len(tree.vertices) < 0.51 * len(faces)
