"""Aligned copies: the main plane on YZ, the main axis on Z, whatever the pose the mesh came in."""

import numpy as np
import pytest
import trimesh

from model import Detector
from model.completion.alignment import alignment
from model.errors import NoPlaneError
from model.geometry.surface import SurfaceIndex
from model.meshes.mesh import Mesh


@pytest.fixture(scope="module")
def detector() -> Detector:
    return Detector.load()


def aligned(detector, mesh):
    matrix = alignment(detector.detect(mesh))
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1.0)
    return Mesh.checked(mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3], mesh.faces), matrix


def posed(mesh, seed):
    matrix = trimesh.transformations.random_rotation_matrix(np.random.default_rng(seed).random(3))
    return Mesh.checked(mesh.vertices @ matrix[:3, :3].T + [3, -7, 11], mesh.faces)


def asymmetry(mesh, linear):
    return np.sqrt(SurfaceIndex(mesh.vertices, mesh.faces).squared_distances(mesh.vertices @ linear).max())


def prism(sides, height=1.0):
    return trimesh.creation.cylinder(1.0, height, sections=sides)


def bracket():
    """One mirror plane, and nothing else."""
    parts = [trimesh.creation.box((2, 4, 0.5)), trimesh.creation.box((2, 0.5, 3))]
    parts[1].apply_translation([0, 1.7, 1.6])
    return trimesh.util.concatenate(parts)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("shape", "order"), [(prism(5, 3.0), 5), (prism(6), 6), (trimesh.creation.cone(1, 3, sections=7), 7)]
)
def test_the_main_axis_goes_to_z_and_a_plane_to_yz(detector, shape, order, seed):
    mesh, _ = aligned(detector, posed(shape, seed))
    angle = 2 * np.pi / order
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    assert asymmetry(mesh, turn) < 1e-6
    assert asymmetry(mesh, np.diag([-1.0, 1, 1])) < 1e-6


@pytest.mark.parametrize("seed", range(3))
def test_a_lone_plane_goes_to_yz(detector, seed):
    mesh, _ = aligned(detector, posed(bracket(), seed))
    assert asymmetry(mesh, np.diag([-1.0, 1, 1])) < 1e-6


def test_what_stands_straight_is_not_turned(detector):
    for shape in (bracket(), prism(6), trimesh.creation.box((1, 2, 3))):
        mesh = Mesh.checked(np.add(shape.vertices, [5, 6, 7]), shape.faces)
        _, matrix = aligned(detector, mesh)
        assert np.abs(matrix[:3, :3]).round(6).sum() == 3  # a permutation of the axes at most
    _, matrix = aligned(detector, Mesh.checked(np.array(bracket().vertices), bracket().faces))
    assert matrix[:3, :3] == pytest.approx(np.eye(3), abs=1e-6)


def test_a_shape_without_symmetry_cannot_be_laid(detector):
    points = np.array([[0, 0, 0], [5, 0, 0], [0, 3, 0], [1, 0.5, 2], [3, 3, 0.2]], dtype=float)
    hull = trimesh.convex.convex_hull(points)
    with pytest.raises(NoPlaneError, match=r"the best has an error of .* Give a larger max_error"):
        aligned(detector, Mesh.checked(hull.vertices, hull.faces))
