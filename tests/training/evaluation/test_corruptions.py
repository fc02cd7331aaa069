"""Damages: noise of the stated size on the surface, a ball gone, fewer faces near the same surface, all repeatable."""

import numpy as np
import pytest

from model.geometry.frames import UnitFrame, triangle_areas
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.geometry.transforms import reflect
from model.meshes.mesh import Mesh
from tests.shapes import as_mesh, box, known, subdivided
from training.evaluation.corruptions import (
    DAMAGES,
    HOLE,
    KEPT_FACES,
    LONGEST_EDGE,
    NOISE,
    RIM_EDGE,
    add_noise,
    corrupt,
    cut_ball,
    decimate,
    edge_lengths,
    subdivide,
    vertex_normals,
)


def diagonal(mesh: Mesh) -> float:
    return float(np.linalg.norm(np.ptp(mesh.vertices[mesh.faces].reshape(-1, 3), axis=0)))


def area(vertices: np.ndarray, faces: np.ndarray) -> float:
    return float(triangle_areas(vertices[faces]).sum())


def open_edges(faces: np.ndarray) -> int:
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return int((np.unique(edges, axis=0, return_counts=True)[1] != 2).sum())


def test_noise_has_the_stated_size_along_the_normals():
    sphere = as_mesh(known("sphere"))
    noisy, _ = add_noise(sphere.vertices, sphere.faces, np.random.default_rng(0))
    size = diagonal(sphere)
    heights = np.linalg.norm(noisy, axis=1) - np.linalg.norm(sphere.vertices, axis=1).mean()
    assert len(noisy) > 2000
    assert heights.std() == pytest.approx(NOISE * size, rel=0.05)
    normals = vertex_normals(sphere.vertices, sphere.faces)
    np.testing.assert_allclose(normals, sphere.vertices / np.linalg.norm(sphere.vertices, axis=1)[:, None], atol=0.02)


def test_noise_is_on_the_sides_of_a_box_and_not_on_its_corners_alone():
    mesh = box()
    noisy, faces = add_noise(mesh.vertices, mesh.faces, np.random.default_rng(0))
    size = diagonal(mesh)
    assert edge_lengths(noisy, faces).max() < (LONGEST_EDGE + 6 * NOISE) * size
    assert open_edges(faces) == 0
    samples, _ = sample_surface(noisy, faces, 4000, seed=0)
    rms = np.sqrt(SurfaceIndex(mesh.vertices, mesh.faces).mean_squared_distance(samples))
    # Inside a triangle three independent heights are averaged, half of the variance is left.
    assert rms == pytest.approx(NOISE * size / np.sqrt(2), rel=0.1)


def test_vertices_at_one_place_move_together():
    pieces = subdivided(box())  # every triangle has corners of its own
    noisy, faces = add_noise(pieces.vertices, pieces.faces, np.random.default_rng(1))
    assert open_edges(faces) == 0
    assert len(np.unique(noisy, axis=0)) == len(noisy)


def test_a_sheet_of_two_sides_is_moved_too():
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3], [0, 2, 1], [0, 3, 2]], dtype=np.int32)
    normals = vertex_normals(corners, faces)
    np.testing.assert_allclose(np.abs(normals[:, 2]), 1.0)


def test_subdivision_keeps_the_surface_and_opens_no_gaps():
    for mesh in (box(), as_mesh(known("antiprism", n=5)), as_mesh(known("star", n=7))):
        vertices, faces = subdivide(mesh.vertices, mesh.faces, 0.1 * diagonal(mesh))
        assert edge_lengths(vertices, faces).max() <= 0.1 * diagonal(mesh)
        assert area(vertices, faces) == pytest.approx(mesh.area)
        assert open_edges(faces) == open_edges(mesh.faces)
        corners = vertices[faces]
        inside = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        volume = np.einsum("fi,fi->", corners[:, 0], inside)
        old = mesh.vertices[mesh.faces]
        expected = np.einsum("fi,fi->", old[:, 0], np.cross(old[:, 1] - old[:, 0], old[:, 2] - old[:, 0]))
        assert volume == pytest.approx(expected)  # no triangle was turned over


@pytest.mark.parametrize("mesh", [box(), as_mesh(known("torus")), as_mesh(known("none"))], ids=["box", "torus", "none"])
def test_a_ball_is_gone_and_nothing_else(mesh: Mesh):
    kept, faces = cut_ball(mesh.vertices, mesh.faces, np.random.default_rng(3))
    radius = HOLE * diagonal(mesh)
    whole, _ = sample_surface(mesh.vertices, mesh.faces, 4000, seed=0)
    gone = np.sqrt(SurfaceIndex(kept, faces).squared_distances(whole)) > 1e-9
    assert 0.005 < gone.mean() < 0.6
    centre = whole[gone].mean(0)
    reach = np.linalg.norm(whole[gone] - centre, axis=1)
    assert reach.max() < 1.5 * radius + RIM_EDGE * diagonal(mesh)
    left, _ = sample_surface(kept, faces, 1000, seed=0)
    assert SurfaceIndex(mesh.vertices, mesh.faces).squared_distances(left).max() < 1e-18


def test_the_hole_is_the_ball():
    """On a large flat square the hole is a disc of the radius, to the triangles of its rim."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
    radius = HOLE * np.sqrt(2.0)
    for seed in range(20):
        kept, left = cut_ball(corners, faces, np.random.default_rng(seed))
        missing = 1.0 - area(kept, left)
        if missing > 0.9 * np.pi * radius**2:
            break
    assert missing == pytest.approx(np.pi * radius**2, rel=0.05)


def test_decimation_leaves_fewer_faces_near_the_surface():
    mesh = as_mesh(known("torus"))
    vertices, faces = decimate(mesh.vertices, mesh.faces)
    assert len(faces) < 0.3 * len(mesh.faces)  # what the largest cell leaves
    samples, _ = sample_surface(vertices, faces, 2000, seed=0)
    rms = np.sqrt(SurfaceIndex(mesh.vertices, mesh.faces).mean_squared_distance(samples))
    assert 0 < rms < 0.01 * diagonal(mesh)


def test_decimation_keeps_what_is_flat_and_sharp():
    mesh = box()
    fine = subdivide(mesh.vertices, mesh.faces, 0.02 * diagonal(mesh))
    vertices, faces = decimate(*fine)
    assert len(faces) <= KEPT_FACES * len(fine[1])
    samples, _ = sample_surface(vertices, faces, 2000, seed=0)
    assert np.sqrt(SurfaceIndex(mesh.vertices, mesh.faces).mean_squared_distance(samples)) < 1e-3 * diagonal(mesh)
    assert np.abs(vertices[faces]).max(axis=(0, 1)) == pytest.approx([0.5, 1.0, 1.5], abs=1e-6)
    np.testing.assert_array_equal(decimate(mesh.vertices, mesh.faces)[1].shape, mesh.faces.shape)


@pytest.mark.parametrize("damage", DAMAGES)
def test_the_same_seed_and_shape_give_the_same_damage(damage: str):
    mesh = as_mesh(known("chair"))
    first, again = (corrupt(mesh.vertices, mesh.faces, damage, 5, 8) for _ in range(2))
    np.testing.assert_array_equal(first.vertices, again.vertices)
    np.testing.assert_array_equal(first.faces, again.faces)
    Mesh.checked(first.vertices, first.faces)
    if damage != "clean":
        other = corrupt(mesh.vertices, mesh.faces, damage, 5, 9)
        assert np.abs(other.similarity.rotation - first.similarity.rotation).max() > 0.01
        rotated = corrupt(mesh.vertices, mesh.faces, "rotated", 5, 8)
        np.testing.assert_array_equal(rotated.similarity.rotation, first.similarity.rotation)


def test_clean_is_the_file_and_planes_come_back_from_every_pose():
    shape = known("mirror")
    mesh = as_mesh(shape)
    clean = corrupt(mesh.vertices, mesh.faces, "clean", 0, 0)
    assert clean.vertices is mesh.vertices
    frame = UnitFrame.of(mesh.vertices, mesh.faces)
    unit = frame.to_unit(mesh.vertices)
    shown = corrupt(mesh.vertices, mesh.faces, "rotated", 0, 4)
    np.testing.assert_allclose(shown.similarity.points_to_unit(shown.vertices), unit, atol=1e-12)
    # A plane seen in the shown mesh is a symmetry of the intact one after the way back.
    normal = shown.similarity.rotation @ shape.planes[0, :3]
    middle = shown.similarity.to_shown(frame.to_unit(-shape.planes[:1, 3:] * shape.planes[0, :3]))[0]
    plane = shown.similarity.planes_to_unit(np.append(normal, -normal @ middle)[None])[0]
    np.testing.assert_allclose(shown.similarity.planes_to_shown(plane[None])[0], np.append(normal, -normal @ middle))
    surface = SurfaceIndex(unit, mesh.faces)
    assert surface.mean_squared_distance(reflect(unit[np.unique(mesh.faces)], plane)) < 1e-24


def test_an_unknown_damage_is_refused():
    with pytest.raises(ValueError, match="damage is one of"):
        corrupt(box().vertices, box().faces, "rust", 0, 0)
