"""The table of edges against plain counting, also of meshes that are no surfaces."""

from collections import Counter

import numpy as np
import pytest

from model.geometry.edges import EdgeTable, is_watertight
from model.geometry.topology import duplicate_vertex_map
from tests.shapes import box, known

MESHES = {
    "chair": (known("chair", 1).vertices, known("chair", 1).faces),
    "open": (box(1, 2, 3).vertices, box(1, 2, 3).faces[2:]),
    # Three faces on one edge, one of them twice, and faces whose corners coincide.
    "crowded": (
        np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0], [0, 0, 0]], dtype=float),
        np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4], [5, 1, 4], [0, 5, 2], [2, 2, 3]], dtype=np.int32),
    ),
    # A vertex where more edges meet than are sorted by insertion.
    "fan": (
        np.concatenate([[[0, 0, 0]], np.random.default_rng(0).normal(size=(60, 3))]),
        np.array([[0, k, k % 60 + 1] for k in range(1, 61)], dtype=np.int32),
    ),
}


def counted(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, Counter[frozenset[int]]]:
    merged = duplicate_vertex_map(vertices)[faces]
    whole = np.array([len(set(row)) == 3 for row in merged.tolist()])
    uses = Counter(frozenset((row[k], row[(k + 1) % 3])) for row in merged[whole].tolist() for k in range(3))
    return merged, uses


@pytest.mark.parametrize("name", MESHES)
def test_open_edges_and_neighbours_are_those_that_counting_finds(name: str) -> None:
    vertices, faces = MESHES[name]
    table = EdgeTable(duplicate_vertex_map(vertices), faces)
    merged, uses = counted(vertices, faces)
    opened, neighbours = table.open, table.neighbours
    some = np.random.default_rng(2).permutation(len(faces))[: len(faces) // 2 + 1]
    np.testing.assert_array_equal(table.neighbours_of(some), neighbours[some])
    for face, row in enumerate(merged.tolist()):
        for k in range(3):
            edge = frozenset((row[k], row[(k + 1) % 3]))
            number = uses[edge] if len(set(row)) == 3 else 0
            assert opened[face, k] == (number == 1)
            assert (neighbours[face, k] >= 0) == (number == 2)
            if number == 2:
                assert neighbours[face, k] != face
                assert edge <= set(merged[neighbours[face, k]].tolist())
    assert table.all_paired == all(number == 2 for number in uses.values())
    assert is_watertight(vertices, faces) == table.all_paired


@pytest.mark.parametrize("name", MESHES)
def test_edges_and_faces_are_known_in_any_order_and_others_are_not(name: str) -> None:
    vertices, faces = MESHES[name]
    table = EdgeTable(duplicate_vertex_map(vertices), faces)
    merged, uses = counted(vertices, faces)
    rng = np.random.default_rng(1)
    triples = np.concatenate([rng.permuted(merged, axis=1), rng.integers(-1, len(vertices), (200, 3))])
    present = {frozenset(row) for row in merged.tolist() if len(set(row)) == 3}
    expected = [frozenset(row) in present and min(row) >= 0 for row in triples.tolist()]
    np.testing.assert_array_equal(table.are_faces(triples.astype(np.int32)), expected)
    pairs = np.concatenate([triples[:, :2], triples[:, 1:]])
    expected = [min(row) >= 0 and uses[frozenset(row)] > 0 for row in pairs.tolist()]
    np.testing.assert_array_equal(table.are_edges(pairs.astype(np.int32)), expected)


@pytest.mark.parametrize("name", MESHES)
def test_faces_at_the_edges_between_three_vertices_have_both_ends(name: str) -> None:
    vertices, faces = MESHES[name]
    table = EdgeTable(duplicate_vertex_map(vertices), faces)
    merged, uses = counted(vertices, faces)
    rng = np.random.default_rng(3)
    triples = np.concatenate([rng.permuted(merged, axis=1), rng.integers(-1, len(vertices), (200, 3))])
    for row, beside in zip(triples.tolist(), table.faces_at(triples.astype(np.int32)).tolist(), strict=True):
        for k in range(3):
            ends = {row[k], row[(k + 1) % 3]}
            found = [face for face in beside[2 * k : 2 * k + 2] if face >= 0]
            assert len(set(found)) == len(found) == min(2, 0 if min(ends) < 0 else uses[frozenset(ends)])
            assert all(ends <= set(merged[face].tolist()) for face in found)
