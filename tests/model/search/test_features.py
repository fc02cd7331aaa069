"""Looks at all features: what need not be measured makes no difference."""

import numpy as np
import pytest

from benchmarks.meshes import SHAPES
from model.geometry.integrals import unit_frame
from model.geometry.operations import Operations
from model.geometry.surface import SurfaceIndex
from model.search._coincidence_kernels import bound_distances, find_coinciding
from model.search.facets import Facets
from model.search.features import Features, Look
from model.types import FloatArray, IntArray

ALLOWED = 1e-5
MIRROR = Operations.reflections(np.array([[1.0, 0.0, 0.0, 0.0]]))


def rough_half_and_its_image(noise: float, *, same_diagonals: bool, seed: int = 0) -> tuple[FloatArray, IntArray]:
    """A sheet of squares with steps, and its mirror image across x = 0, vertices off by ``noise``."""
    rng = np.random.default_rng(seed)
    steps = 13
    x, y = np.meshgrid(np.linspace(0.1, 0.5, steps), np.linspace(-0.3, 0.3, steps), indexing="ij")
    z = 0.02 * np.repeat(rng.integers(0, 3, (steps, 1)), steps, axis=1)
    half = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    corner = (np.arange(steps - 1)[:, None] * steps + np.arange(steps - 1)).ravel()
    a, b, c, d = corner, corner + 1, corner + steps + 1, corner + steps
    one, other = np.stack([a, b, c, a, c, d], 1).reshape(-1, 3), np.stack([a, b, d, b, c, d], 1).reshape(-1, 3)
    image = half * [-1.0, 1.0, 1.0] + noise * rng.normal(size=half.shape)
    order = rng.permutation(len(half))
    beyond = np.argsort(order)[one if same_diagonals else other] + len(half)
    return np.concatenate([half, image[order]]), np.concatenate([one, beyond[:, ::-1]]).astype(np.int32)


def features_of(vertices: FloatArray, faces: IntArray) -> Features:
    return Features(SurfaceIndex(vertices, faces), Facets(vertices, faces), ALLOWED)


def measured(features: Features, look: Look, operation: Operations) -> Look:
    """The same features without any short cut."""
    return features.measure(look.points, look.sagittas, operation)


@pytest.mark.parametrize("same_diagonals", [True, False])
@pytest.mark.parametrize("noise", [0.0, 1e-8, 1e-6])
def test_what_holds_is_as_large_as_measured(noise: float, same_diagonals: bool) -> None:
    vertices, faces = rough_half_and_its_image(noise, same_diagonals=same_diagonals)
    features = features_of(vertices, faces)
    look = features.look(MIRROR)
    full = measured(features, look, MIRROR)
    assert not look.bad.any()
    assert not full.bad.any()
    assert look.bounded.mean() > 0.5
    assert abs(look.deviations.max() - full.deviations.max()) < 1e-12
    exact = ~look.bounded
    np.testing.assert_allclose(look.deviations[exact], full.deviations[exact], atol=1e-15)


@pytest.mark.parametrize("same_diagonals", [True, False])
def test_one_vertex_out_of_place_is_found(same_diagonals: bool) -> None:
    vertices, faces = rough_half_and_its_image(1e-8, same_diagonals=same_diagonals)
    vertices[40] += [0.0, 0.0, 0.01]
    features = features_of(vertices, faces)
    look = features.look(MIRROR)
    full = measured(features, look, MIRROR)
    assert look.bad.any()
    np.testing.assert_array_equal(look.bad, full.bad)
    np.testing.assert_array_equal(look.deviations[look.bad], full.deviations[full.bad])
    assert np.linalg.norm((look.points[look.bad] - vertices[40]) * [0, 1, 1], axis=1).min() < 0.01


def test_a_missing_face_is_no_coincidence_of_its_corners() -> None:
    vertices, faces = rough_half_and_its_image(0.0, same_diagonals=True)
    half = len(faces) // 2
    gone = half + np.flatnonzero((vertices[faces[half:]] > [-1.0, -0.2, -1.0]).all(axis=(1, 2)))[50:60]
    features = features_of(vertices, np.delete(faces, gone, axis=0))
    look = features.look(MIRROR)
    assert look.bad.any()


def test_images_coincide_with_the_nearest_vertex_that_counts() -> None:
    rng = np.random.default_rng(4)
    vertices = rng.uniform(-0.5, 0.5, (400, 3))
    vertices[:8] = vertices[0] + rng.normal(size=(8, 3)) * 1e-3  # several in one cell
    distance, count = 1e-3, 300
    points = (vertices[rng.integers(0, 400, count)] + rng.normal(size=(count, 3)) * 4e-4) * [-1.0, 1.0, 1.0]
    places = rng.random(400) < 0.7
    found, gaps = np.empty(count, dtype=np.int32), np.empty(count)
    find_coinciding(points, np.zeros(3), np.diag([-1.0, 1.0, 1.0]), vertices, places, distance, found, gaps)
    apart = np.linalg.norm(points[:, None] * [-1.0, 1.0, 1.0] - vertices, axis=2)
    apart[:, ~places] = np.inf
    near = apart.min(1) <= distance
    np.testing.assert_array_equal(found >= 0, near)
    np.testing.assert_array_equal(found[near], apart.argmin(1)[near])
    np.testing.assert_allclose(gaps[near], apart.min(1)[near], rtol=1e-9)
    assert np.isinf(gaps[~near]).all()
    assert 50 < near.sum() < 290


def test_where_vertices_crowd_the_rest_is_left_unsaid() -> None:
    vertices = np.random.default_rng(5).uniform(-1e-6, 1e-6, (4_000, 3))
    found, gaps = np.empty(4_000, dtype=np.int32), np.empty(4_000)
    find_coinciding(vertices, np.zeros(3), np.eye(3), vertices, np.ones(4_000, dtype=np.bool_), 1e-5, found, gaps)
    told = found >= 0
    assert told.any()
    apart = np.linalg.norm(vertices[told] - vertices[found[told]], axis=1)
    np.testing.assert_allclose(gaps[told], apart, atol=1e-15)


def test_bounds_are_distances_from_the_candidates() -> None:
    rng = np.random.default_rng(6)
    vertices, count = rng.uniform(-0.5, 0.5, (60, 3)), 200
    faces = rng.integers(0, 60, (50, 3)).astype(np.int32)  # some of them lines or points
    faces[:5] = faces[:5, :1]
    points, candidates = rng.uniform(-0.5, 0.5, (count, 3)), rng.integers(-1, 50, (count, 6)).astype(np.int32)
    candidates[0] = -1
    bounds = np.empty(count)
    bound_distances(points, np.zeros(3), np.eye(3), candidates, vertices, faces, bounds)
    assert np.isinf(bounds[0])
    for i in range(1, count):
        each = [
            float(SurfaceIndex(vertices, faces[[face]]).squared_distances(points[[i]])[0]) ** 0.5
            for face in candidates[i].tolist()
            if face >= 0
        ]
        assert min(abs(np.array(each) - bounds[i])) < 1e-12
        assert bounds[i] >= min(each) - 1e-12


@pytest.mark.parametrize("shape", ["slivers", "rough", "soup"])
def test_sagittas_of_some_faces_are_those_of_all(shape: str) -> None:
    vertices, faces = SHAPES[shape](2_000)
    unit = unit_frame(vertices, faces).to_unit(vertices)
    facets = Facets(unit, faces)
    owners = np.random.default_rng(7).integers(0, len(faces), 100)
    some = Facets(unit, faces).sagittas_of(owners)
    np.testing.assert_array_equal(some, facets.sagittas[0][owners])
    assert shape == "soup" or some.any()
