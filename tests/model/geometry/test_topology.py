"""Vertices at one place, and surfaces that have one of them each."""

import numpy as np
import pytest

from model.geometry.topology import are_equal, duplicate_vertex_map, welded


def corners_of(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Faces between few places, each with corners of its own."""
    rng = np.random.default_rng(count)
    places = np.round(rng.normal(size=(count // 2 + 3, 3)), 1)
    vertices = places[rng.integers(0, len(places), 3 * count)]
    return vertices, rng.permutation(3 * count).reshape(-1, 3).astype(np.int32)


@pytest.mark.parametrize("count", [1, 7, 100, 3000])
def test_a_welded_surface_has_the_same_corners_and_each_place_once(count: int) -> None:
    vertices, faces = corners_of(count)
    places, numbers = welded(vertices, faces)
    np.testing.assert_array_equal(places[numbers], vertices[faces])
    assert len(np.unique(places, axis=0)) == len(places) == len(np.unique(vertices, axis=0))
    # In the order in which they come first: what follows from the numbers does not change.
    first = duplicate_vertex_map(vertices)
    np.testing.assert_array_equal(places, vertices[np.unique(first)])


def test_all_different_vertices_and_shared_ones_stay_as_they_are() -> None:
    vertices = np.random.default_rng(0).normal(size=(3000, 3))
    faces = np.arange(3000, dtype=np.int32).reshape(-1, 3)
    assert welded(vertices, faces) == (vertices, faces)
    vertices[1] = vertices[0]
    shared = np.concatenate([faces] * 3)
    assert welded(vertices, shared) == (vertices, shared)


def test_zeros_of_both_signs_are_one_place_and_unused_vertices_may_be_anything() -> None:
    vertices = np.array([[0.0, 0, 0], [-0.0, 0, 0], [1, 0, 0], [1, -0.0, 0], [0, 1, 0], [np.nan] * 3, [np.nan] * 3])
    places, faces = welded(vertices, np.array([[0, 2, 4], [1, 4, 3]], dtype=np.int32))
    assert faces.tolist() == [[0, 1, 2], [0, 2, 1]]
    assert np.isnan(places[3:]).all()


def test_a_map_to_first_vertices_is_told_from_one_to_others() -> None:
    vertices, _ = corners_of(50)
    first = duplicate_vertex_map(vertices)
    assert are_equal(vertices, first)
    moved = vertices.copy()
    moved[np.flatnonzero(first != np.arange(len(first)))[-1]] += 1e-12
    assert not are_equal(moved, first)
