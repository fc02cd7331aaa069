import numpy as np
import pytest
import trimesh

from model.errors import DegenerateMeshError, EmptyMeshError, UnreadableMeshError
from model.formats.conversion import as_mesh
from model.meshes.mesh import Mesh

TRIANGLE = np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0.0]])
FACE = np.array([[0, 1, 2]])


def test_arrays_have_the_promised_layout():
    mesh = Mesh.checked(TRIANGLE.astype(np.float32)[:, ::-1], FACE.astype(np.int64))
    assert mesh.vertices.dtype == np.float64
    assert mesh.faces.dtype == np.int32
    assert mesh.vertices.flags.c_contiguous
    assert mesh.faces.flags.c_contiguous


def test_area_and_bounds():
    mesh = Mesh.checked(TRIANGLE, FACE)
    assert mesh.area == 3
    assert mesh.bounds.tolist() == [[0, 0, 0], [2, 3, 0]]


def test_unused_vertices_are_ignored():
    vertices = np.concatenate([TRIANGLE, [[99, 99, 99], [np.nan, 0, np.inf]]])
    assert Mesh.checked(vertices, FACE).bounds.tolist() == [[0, 0, 0], [2, 3, 0]]


@pytest.mark.parametrize(
    ("vertices", "faces", "error"),
    [
        (TRIANGLE, np.empty((0, 3), dtype=int), EmptyMeshError),
        (np.empty((0, 3)), [], EmptyMeshError),
        (TRIANGLE, [[0, 1, 3]], DegenerateMeshError),
        (TRIANGLE, [[0, 1, -1]], DegenerateMeshError),
        (TRIANGLE, np.array([[0, 1, 2**40]]), DegenerateMeshError),
        (TRIANGLE * [1, np.nan, 1], FACE, DegenerateMeshError),
        (TRIANGLE + np.array([0, -np.inf, 0]), FACE, DegenerateMeshError),
        (TRIANGLE * 1e200, FACE, DegenerateMeshError),
        (TRIANGLE * 0, FACE, DegenerateMeshError),
        (TRIANGLE * [1, 0, 1], FACE, DegenerateMeshError),
        (TRIANGLE[:, :2], FACE, UnreadableMeshError),
        (TRIANGLE, [[0, 1, 2, 0]], UnreadableMeshError),
        (TRIANGLE, [[0.0, 1.0, 2.0]], UnreadableMeshError),
        ("words", FACE, UnreadableMeshError),
    ],
)
def test_unusable_meshes_are_refused(vertices, faces, error):
    with pytest.raises(error):
        Mesh.checked(vertices, faces)


@pytest.mark.parametrize("scale", [1e-30, 1e-6, 1, 1e6, 1e30])
def test_size_does_not_matter(scale):
    mesh = Mesh.checked(TRIANGLE * scale, FACE)
    assert mesh.area == pytest.approx(3 * scale**2, rel=1e-12)


def test_points_on_a_skew_line_have_no_area():
    # Rounding gives such a triangle an area of about 1e-17, not zero.
    line = np.array([[0.1, 0.2, 0.3]]) * np.array([[1], [3], [7]]) + 0.7
    with pytest.raises(DegenerateMeshError, match="area"):
        Mesh.checked(line, FACE)


def test_watertight():
    box = trimesh.creation.box()
    assert Mesh.checked(box.vertices, box.faces).watertight
    assert not Mesh.checked(box.vertices, box.faces[1:]).watertight
    doubled = np.concatenate([box.faces, box.faces])
    assert not Mesh.checked(box.vertices, doubled).watertight
    sphere = trimesh.creation.icosphere(subdivisions=3)
    assert Mesh.checked(sphere.vertices, sphere.faces).watertight


def test_watertight_merges_equal_positions_but_not_close_ones():
    box = trimesh.creation.box()
    corners = box.vertices[box.faces].reshape(-1, 3)
    faces = np.arange(len(corners)).reshape(-1, 3)
    assert Mesh.checked(corners, faces).watertight
    signed = np.where(corners - 0.5 == 0, -0.0, corners - 0.5)  # both zeros are one position
    signed[::2][signed[::2] == 0] = 0.0
    assert Mesh.checked(signed, faces).watertight
    corners[0] += 1e-9
    assert not Mesh.checked(corners, faces).watertight


def test_a_fan_of_many_faces_around_one_edge_is_not_watertight():
    count = 3001
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    rim = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    vertices = np.concatenate([[[0, 0, 0], [0, 0, 1]], rim])
    faces = np.stack([np.zeros(count, int), np.ones(count, int), np.arange(2, count + 2)], axis=1)
    assert not Mesh.checked(vertices, faces).watertight


def test_as_mesh_takes_what_a_caller_holds(tmp_path):
    box = trimesh.creation.box((1, 2, 3))
    path = tmp_path / "box.obj"
    box.export(path)
    own = Mesh.checked(box.vertices, box.faces)
    assert as_mesh(own) is own
    for value in (box, (box.vertices, box.faces), [box.vertices, box.faces], path, str(path)):
        mesh = as_mesh(value)
        assert mesh.area == pytest.approx(22)
        assert mesh.watertight
    assert as_mesh(path).source_format == "obj"
    assert as_mesh(box).source_format is None


def test_as_mesh_takes_a_scene_in_world_coordinates():
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box(), transform=trimesh.transformations.translation_matrix([5, 0, 0]))
    scene.add_geometry(trimesh.creation.box(), transform=trimesh.transformations.scale_matrix(2))
    mesh = as_mesh(scene)
    assert mesh.bounds == pytest.approx(np.array([[-1, -1, -1], [5.5, 1, 1]]))
    assert mesh.area == pytest.approx(6 + 24)


def test_as_mesh_refuses_anything_else():
    with pytest.raises(TypeError):
        as_mesh(42)
    with pytest.raises(FileNotFoundError):
        as_mesh("does-not-exist.obj")
