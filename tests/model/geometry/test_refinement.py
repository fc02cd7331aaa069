"""Refinement finds the exact element again after it was moved, also on damaged surfaces."""

import numpy as np
import pytest

from model.geometry.frames import UnitFrame
from model.geometry.operations import Operations
from model.geometry.refinement import refine, refine_planes, squared_distances
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from tests.shapes import as_mesh, box, known, moved
from training.evaluation.corruptions import corrupt
from training.shapes.solids import random_rotation


def prepared(vertices: np.ndarray, faces: np.ndarray, count: int = 300) -> tuple[SurfaceIndex, np.ndarray]:
    return SurfaceIndex(vertices, faces), sample_surface(vertices, faces, count, seed=5)[0]


def tilted(direction: np.ndarray, degrees: float, rng: np.random.Generator) -> np.ndarray:
    side = np.cross(direction, rng.normal(size=3))
    side /= np.linalg.norm(side)
    return np.cos(np.deg2rad(degrees)) * direction + np.sin(np.deg2rad(degrees)) * side


@pytest.mark.parametrize("family", ["chair", "table", "prism", "pyramid"])
@pytest.mark.parametrize("seed", range(3))
def test_a_tilted_and_shifted_plane_comes_back(family: str, seed: int):
    rng = np.random.default_rng(seed)
    shape = known(family, seed)
    turn = random_rotation(rng)
    mesh = moved(as_mesh(shape), turn, np.zeros(3), 1.0)
    frame = UnitFrame.of(mesh.vertices, mesh.faces)
    surface, samples = prepared(frame.to_unit(mesh.vertices), mesh.faces)
    normal = turn @ shape.planes[0, :3]
    begin = np.append(tilted(normal, 5.0, rng), 0.02)
    plane = refine_planes(surface, samples, begin[None])[0]
    assert np.linalg.norm(np.cross(plane[:3], normal)) < 1e-6
    assert abs(plane[3]) < 1e-6


@pytest.mark.parametrize(("family", "n"), [("cyclic", 5), ("gear", 7), ("dihedral", 3)])
def test_an_axis_comes_back_with_its_position(family: str, n: int):
    rng = np.random.default_rng(2)
    shape = known(family, 1, n=n)
    frame = UnitFrame.of(shape.vertices, shape.faces)
    surface, samples = prepared(frame.to_unit(shape.vertices), shape.faces)
    axis = next(axis for axis in shape.axes if axis.order == n)
    start = Operations.rotations(tilted(axis.direction, 4.0, rng), np.array([0.02, -0.015, 0.01]), 2.0 * np.pi / n)
    found = refine(surface, samples, start)
    direction, point = found.directions[0], found.points[0]
    assert np.linalg.norm(np.cross(direction, axis.direction)) < 1e-7
    off = point - frame.to_unit(axis.point)
    assert np.linalg.norm(off - (off @ axis.direction) * axis.direction) < 1e-7


def test_a_hole_does_not_pull_the_plane_away():
    mesh = as_mesh(known("chair"))
    for index in range(4):
        shown = corrupt(mesh.vertices, mesh.faces, "partial", seed=3, index=index)
        vertices = shown.similarity.points_to_unit(shown.vertices)
        surface, samples = prepared(vertices, shown.faces, 400)
        start = np.append(tilted(np.array([1.0, 0.0, 0.0]), 3.0, np.random.default_rng(index)), 0.01)
        plane = refine_planes(surface, samples, start[None])[0]
        assert np.degrees(np.linalg.norm(np.cross(plane[:3], [1.0, 0.0, 0.0]))) < 0.05
        assert abs(plane[3]) < 1e-3


def test_noise_moves_the_plane_by_less_than_its_own_size():
    mesh = as_mesh(known("chair"))
    shown = corrupt(mesh.vertices, mesh.faces, "noisy", seed=3, index=0)
    surface, samples = prepared(shown.similarity.points_to_unit(shown.vertices), shown.faces, 400)
    plane = refine_planes(surface, samples, np.array([[0.999, 0.03, -0.03, 0.01]]))[0]
    assert np.degrees(np.linalg.norm(np.cross(plane[:3], [1.0, 0.0, 0.0]))) < 0.5


def test_distances_of_images_are_those_of_the_surface():
    mesh = box(0.3, 0.5, 0.7)
    turned = moved(mesh, random_rotation(np.random.default_rng(7)), np.zeros(3), 1.0)
    for case in (mesh, turned):
        surface, samples = prepared(case.vertices, case.faces, 100)
        operations = Operations.joined(
            [
                Operations.reflections(np.array([[0.6, 0.0, 0.8, 0.1]])),
                Operations.rotations(np.array([0.0, 0.6, 0.8]), np.array([0.1, 0.0, 0.0]), 0.4),
            ]
        )
        expected = [surface.squared_distances(images) for images in operations.apply(samples)]
        np.testing.assert_allclose(squared_distances(surface, samples, operations), expected, atol=1e-15)


def test_each_candidate_is_refined_as_if_it_were_alone():
    mesh = as_mesh(known("chair"))
    frame = UnitFrame.of(mesh.vertices, mesh.faces)
    surface, samples = prepared(frame.to_unit(mesh.vertices), mesh.faces)
    starts = np.array([[1.0, 0.02, 0.0, 0.0], [0.1, 1.0, 0.0, 0.0], [0.0, 0.1, 1.0, 0.05]])
    starts[:, :3] /= np.linalg.norm(starts[:, :3], axis=1, keepdims=True)
    together = refine_planes(surface, samples, starts)
    for k, start in enumerate(starts):
        np.testing.assert_allclose(refine_planes(surface, samples, start[None])[0], together[k], atol=1e-9)


def test_nothing_to_refine_is_nothing():
    surface, samples = prepared(box().vertices, box().faces, 50)
    assert refine_planes(surface, samples, np.zeros((0, 4))).shape == (0, 4)
