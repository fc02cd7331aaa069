"""Clouds drawn from known surfaces: what joins them is that surface, and its symmetries are found on it."""

import numpy as np
import pytest

from model.detector import Detector
from model.errors import DegenerateMeshError, EmptyMeshError
from model.geometry.edges import EdgeTable
from model.geometry.frames import triangle_areas
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.geometry.topology import duplicate_vertex_map
from model.meshes.mesh import LARGEST_COORDINATE, Mesh
from model.meshes.points import MOST_POINTS, PointSurface, surface_of_points
from model.types import FloatArray
from tests.shapes import box


def sphere(count: int, seed: int = 0) -> FloatArray:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True)


def joined(points: FloatArray) -> PointSurface:
    return surface_of_points(points, LARGEST_COORDINATE)


def test_a_sphere_is_closed_but_for_rare_gaps_and_looks_outwards():
    found = joined(sphere(5000))
    corners = found.vertices[found.faces]
    assert triangle_areas(corners).sum() == pytest.approx(4 * np.pi, rel=0.05)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("ij,ij->i", normals, corners.mean(1)) > 0).mean() > 0.999
    edges = EdgeTable(duplicate_vertex_map(found.vertices), found.faces).open
    assert edges.mean() < 0.01
    np.testing.assert_allclose(np.linalg.norm(found.vertices, axis=1), 1.0)


def test_the_rim_of_a_half_is_open_and_the_hole_is_not_bridged():
    points = sphere(8000)
    found = joined(points[points[:, 2] > 0])
    edges = EdgeTable(duplicate_vertex_map(found.vertices), found.faces).open
    inside = found.vertices[found.faces].mean(1)[:, 2] > 0.2
    assert edges[inside].mean() < 0.01
    rim = found.vertices[:, 2] < 0.01
    assert np.isin(np.flatnonzero(rim), found.faces[edges.any(1)]).mean() > 0.9
    # Of the disc across the rim nothing is covered.
    disc = 0.6 * sphere(300)[:, :2]
    distance = SurfaceIndex(found.vertices, found.faces).squared_distances(np.column_stack([disc, np.zeros(300)]))
    assert distance.min() > 0.05


def test_uneven_density_duplicates_outliers_and_holes_in_the_data_are_tolerated():
    rng = np.random.default_rng(1)
    points = sphere(12_000)
    points = points[rng.random(len(points)) < 0.25 + 0.75 * (points[:, 0] > 0)]
    outliers = 3.0 * sphere(40, 5) * rng.uniform(0.6, 1.0, (40, 1))
    nowhere = np.full((100, 3), np.nan)
    found = joined(np.concatenate([points, points[:3000], outliers, nowhere, [[1e9, 0, 0]]]))
    assert found.broken == 100
    assert found.outliers >= 38
    assert found.thinned >= 3000
    off = np.abs(np.linalg.norm(found.vertices, axis=1) - 1.0)
    assert (off < 1e-6).mean() > 0.999
    assert triangle_areas(found.vertices[found.faces]).sum() == pytest.approx(4 * np.pi, rel=0.1)


def test_noise_as_large_as_the_spacing_is_smoothed_and_smaller_noise_left():
    points = sphere(10_000)
    noisy = points + np.random.default_rng(2).normal(0.0, 0.01, points.shape)
    found = joined(noisy)
    off = np.abs(np.linalg.norm(found.vertices, axis=1) - 1.0).mean()
    assert off < 0.6 * np.abs(np.linalg.norm(noisy, axis=1) - 1.0).mean()
    assert triangle_areas(found.vertices[found.faces]).sum() == pytest.approx(4 * np.pi, rel=0.1)


def test_large_clouds_are_thinned_evenly():
    found = joined(sphere(80_000))
    assert 0.5 * MOST_POINTS < len(found.vertices) <= MOST_POINTS
    assert found.thinned == 80_000 - len(found.vertices)
    areas = triangle_areas(found.vertices[found.faces])
    assert areas.max() < 20 * areas.mean()


def test_the_frame_does_not_matter():
    points = sphere(2000)
    here, there = joined(points), joined(1e-3 * points + [1e3, 0.0, -50.0])
    # Far from the origin some digits are lost, and with them which of two points of a cell is kept.
    assert len(there.faces) == pytest.approx(len(here.faces), rel=0.01)


@pytest.mark.parametrize("count", [0, 1, 49])
def test_too_few_points_are_refused(count: int):
    with pytest.raises(EmptyMeshError, match="too few to show a surface"):
        joined(sphere(count))


@pytest.mark.parametrize("points", [np.zeros((200, 3)), np.full((200, 3), 7.0)])
def test_points_at_one_place_are_refused(points: FloatArray):
    with pytest.raises(DegenerateMeshError, match="coincide"):
        joined(points)


@pytest.mark.parametrize(
    "points",
    [
        np.column_stack([np.linspace(0, 1, 500), np.zeros(500), np.zeros(500)]),
        np.random.default_rng(0).random((3000, 3)),
        np.concatenate([1e-6 * np.random.default_rng(0).random((3000, 3)), np.eye(3)]),
        np.tile(np.random.default_rng(0).random((60, 3)), (50, 1)),
        np.stack(np.meshgrid(*[np.arange(20.0)] * 3), axis=-1).reshape(-1, 3),
    ],
    ids=["line", "volume", "far corners", "repeated", "lattice"],
)
def test_what_is_no_surface_gives_a_mesh_or_a_reason(points: FloatArray):
    try:
        found = joined(points)
        Mesh.checked(found.vertices, found.faces)
    except (EmptyMeshError, DegenerateMeshError):
        return
    assert np.isfinite(found.vertices).all()


def test_the_planes_of_a_box_are_found_on_its_points():
    mesh = box(1.0, 2.0, 3.0)
    points, _ = sample_surface(mesh.vertices, mesh.faces, 6000, seed=4)
    points = points + np.random.default_rng(0).normal(0.0, 0.003, points.shape)
    found = joined(points)
    answer = Detector.load().detect(Mesh.checked(found.vertices, found.faces, kind="points"))
    assert answer.point_group == "D2h"
    for axis in np.eye(3):
        best = max(answer.planes, key=lambda plane: abs(plane.normal @ axis))
        assert abs(best.normal @ axis) > np.cos(np.deg2rad(0.5))
        assert not best.exact
        assert best.coverage > 0.9
