"""Frames move with the shape, whatever its pose, size, tessellation or distance from the origin."""

import numpy as np
import pytest

from benchmarks.meshes import displaced_sphere
from model.errors import DegenerateMeshError
from model.geometry.frames import UnitFrame, inertia_frame
from model.geometry.integrals import inertia_rotation, principal_frame, unit_frame
from model.geometry.sampling import sample_surface
from model.meshes.mesh import Mesh
from tests.shapes import as_mesh, box, known, moved, pose, subdivided
from training.shapes.solids import random_rotation


def shapes() -> list[Mesh]:
    from training.shapes.catalogue import families

    return [as_mesh(known(family)) for family in families()[:6]] + [box()]


@pytest.mark.parametrize("seed", range(3))
def test_unit_frame_follows_rotation_translation_and_scale(seed: int):
    rotation, translation, scale = pose(seed)
    for mesh in shapes():
        frame = UnitFrame.of(mesh.vertices, mesh.faces)
        other = moved(mesh, rotation, translation, scale)
        turned = UnitFrame.of(other.vertices, other.faces)
        np.testing.assert_allclose(
            turned.to_unit(other.vertices), frame.to_unit(mesh.vertices) @ rotation.T, atol=1e-11
        )
        assert turned.scale == pytest.approx(scale * frame.scale, rel=1e-12)


def test_unit_frame_is_a_ball_of_diameter_one_about_the_area_centroid():
    for mesh in shapes():
        frame = UnitFrame.of(mesh.vertices, mesh.faces)
        used = frame.to_unit(mesh.vertices)[np.unique(mesh.faces)]
        assert np.linalg.norm(used, axis=1).max() == pytest.approx(0.5, rel=1e-12)
        samples, _ = sample_surface(frame.to_unit(mesh.vertices), mesh.faces, 40_000, seed=1)
        assert np.abs(samples.mean(0)).max() < 5e-3


def test_unit_frame_does_not_see_the_tessellation_or_stray_vertices():
    mesh = as_mesh(known("chair"))
    frame = UnitFrame.of(mesh.vertices, mesh.faces)
    finer = subdivided(subdivided(mesh))
    again = UnitFrame.of(finer.vertices, finer.faces)
    np.testing.assert_allclose(again.center, frame.center, atol=1e-12)
    assert again.scale == pytest.approx(frame.scale, rel=1e-12)
    stray = np.vstack([mesh.vertices, [[1e6, 1e6, 1e6]]])
    assert UnitFrame.of(stray, mesh.faces).scale == frame.scale


def test_unit_frame_survives_distance_and_tiny_units():
    mesh = box()
    for scale, shift in ((1e-9, 0.0), (1e9, 0.0), (1.0, 1e6)):
        far = Mesh.checked(scale * mesh.vertices + shift, mesh.faces)
        frame = UnitFrame.of(far.vertices, far.faces)
        np.testing.assert_allclose(
            frame.to_unit(far.vertices), UnitFrame.of(mesh.vertices, mesh.faces).to_unit(mesh.vertices), atol=1e-8
        )


def test_points_and_planes_come_back():
    mesh = moved(box(), *pose(5))
    frame = UnitFrame.of(mesh.vertices, mesh.faces)
    np.testing.assert_allclose(frame.to_input(frame.to_unit(mesh.vertices)), mesh.vertices, rtol=1e-12)
    plane = np.array([0.6, 0.0, 0.8, 0.13])
    on_plane = np.array([[0.6, 0.0, 0.8], [0.8, 0.0, -0.6], [0.0, 1.0, 0.0]])
    on_plane -= ((on_plane @ plane[:3] + plane[3])[:, None]) * plane[:3]
    moved_plane = frame.plane_to_input(plane)
    np.testing.assert_allclose(
        frame.to_input(on_plane) @ moved_plane[:3] + moved_plane[3], 0.0, atol=1e-9 * frame.scale
    )


def test_flat_and_collapsed_meshes_are_told_apart():
    faces = np.array([[0, 1, 2]], dtype=np.int32)
    UnitFrame.of(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), faces)
    with pytest.raises(DegenerateMeshError, match="no area"):
        UnitFrame.of(np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]), faces)
    with pytest.raises(DegenerateMeshError, match="no extent"):
        UnitFrame.of(np.ones((3, 3)), faces)


def test_inertia_frame_finds_the_axes_of_a_box_in_any_pose():
    mesh = box(1.0, 2.0, 3.0)
    for seed in range(4):
        rotation, _, _ = pose(seed)
        frame, values = inertia_frame(np.ascontiguousarray(mesh.vertices @ rotation.T / 10), mesh.faces)
        assert np.linalg.det(frame) == pytest.approx(1.0)
        assert (np.diff(values) < 0).all()
        # z is the longest edge, so its variance is the largest.
        np.testing.assert_allclose(np.abs(frame @ rotation), np.eye(3)[::-1], atol=1e-9)


def test_covariance_is_the_surface_integral():
    mesh = as_mesh(known("chair"))
    vertices = UnitFrame.of(mesh.vertices, mesh.faces).to_unit(mesh.vertices)
    samples, _ = sample_surface(vertices, mesh.faces, 200_000, seed=3)
    frame, values = inertia_frame(vertices, mesh.faces)
    np.testing.assert_allclose(
        frame @ (samples.T @ samples / len(samples)) @ frame.T, np.diag(values), atol=1e-3 * values[0]
    )


def test_an_inertia_frame_is_looked_at_from_the_same_side_in_every_pose():
    mesh = as_mesh(known("none", 1))
    frame = UnitFrame.of(mesh.vertices, mesh.faces)
    vertices = frame.to_unit(mesh.vertices)
    still = principal_frame(vertices, mesh.faces)
    for seed in range(6):
        turn = random_rotation(np.random.default_rng(seed))
        turned = np.ascontiguousarray(vertices @ turn.T)
        found = principal_frame(turned, mesh.faces)
        assert np.linalg.det(found) == pytest.approx(1.0)
        np.testing.assert_allclose(found, still @ turn.T, atol=1e-9)


def test_compiled_frames_are_those_of_numpy():
    """Also of many blocks of faces, far from the origin, with vertices that no face uses."""
    large = Mesh.checked(*displaced_sphere(30_000))
    for mesh in [*shapes(), large]:
        rotation, translation, scale = pose(3)
        other = moved(mesh, rotation, 100.0 * translation, scale)
        vertices = np.concatenate([other.vertices, [[np.nan] * 3, [1e9] * 3]])
        ours, theirs = unit_frame(vertices, other.faces), UnitFrame.of(vertices, other.faces)
        np.testing.assert_allclose(ours.center, theirs.center, rtol=1e-13)
        assert ours.scale == pytest.approx(theirs.scale, rel=1e-12)
        unit = np.ascontiguousarray(ours.to_unit(other.vertices))
        expected, values = inertia_frame(unit, other.faces)
        if np.abs(np.diff(values)).min() > 1e-3:  # else the axes are arbitrary
            np.testing.assert_allclose(inertia_rotation(unit, other.faces), expected, atol=1e-9)


@pytest.mark.parametrize("size", [0.0, 1.0])
def test_compiled_frames_refuse_what_has_no_area(size: float):
    vertices = size * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]])
    faces = np.array([[0, 1, 2]], dtype=np.int32)
    for frame in (UnitFrame.of, unit_frame):
        with pytest.raises(DegenerateMeshError):
            frame(vertices, faces)


@pytest.mark.parametrize("order", [3, 4, 7])
def test_where_moments_tie_rounding_does_not_choose_the_frame(order: int):
    """A prism on a regular polygon, in any pose: the last digits of its coordinates do not turn its frame."""
    angles = 2.0 * np.pi * np.arange(order) / order
    circle = 0.3 * np.column_stack([np.cos(angles), np.sin(angles)])
    vertices = np.concatenate([np.column_stack([circle, np.full(order, height)]) for height in (-0.2, 0.2)])
    j = np.arange(order)
    k = (j + 1) % order
    faces = np.concatenate([np.stack([j, k, k + order], 1), np.stack([j, k + order, j + order], 1)]).astype(np.int32)
    rng = np.random.default_rng(order)
    for turn in [np.eye(3), *[random_rotation(rng) for _ in range(4)]]:
        found = [
            inertia_rotation(np.ascontiguousarray((vertices + 1e-9 * rng.normal(size=vertices.shape)) @ turn.T), faces)
            for _ in range(4)
        ]
        assert np.linalg.det(found[0]) == pytest.approx(1.0)
        for other in found[1:]:
            np.testing.assert_allclose(np.abs(np.sum(found[0] * other, axis=1)), 1.0, atol=1e-9)
