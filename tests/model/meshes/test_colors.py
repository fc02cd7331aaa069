"""Colours: read from the formats that have them, carried to what is made of a mesh, written where a format can."""

import numpy as np
import pytest
import trimesh

from app import align, complete, editing
from app.outputs.registry import MESH_WRITERS
from model.formats import read_mesh
from model.meshes.colors import from_linear, to_linear
from model.meshes.mesh import Mesh
from tests.model.formats.test_gltf_as_shown import U8, Document

RED, BLUE = [255, 0, 0, 255], [0, 0, 255, 255]


def painted() -> Mesh:
    """A box that is red below z = 0 and blue above, with a sharp edge between, made of many faces."""
    box = trimesh.creation.box((4, 2, 2)).subdivide().subdivide()
    corners = np.array(box.triangles).reshape(-1, 3)
    above = np.repeat(box.triangles_center[:, 2] > 0, 3)
    colors = np.where(above[:, None], BLUE, RED).astype(np.uint8)
    return Mesh.checked(corners, np.arange(len(corners)).reshape(-1, 3), colors=colors)


def require_painted(mesh: Mesh, axis: int = 2) -> None:
    assert mesh.colors is not None
    centres = mesh.vertices[mesh.faces].mean(axis=1)[:, axis]
    for corner in range(3):
        colors = mesh.colors[mesh.faces[:, corner]]
        assert (colors[centres > 0.01] == BLUE).all()
        assert (colors[centres < -0.01] == RED).all()


@pytest.mark.parametrize("kind", ["ply", "glb", "obj"])
def test_colours_survive_a_round_trip(kind: str) -> None:
    mesh = painted()
    rng = np.random.default_rng(1)
    colors = rng.integers(0, 256, (len(mesh.vertices), 4)).astype(np.uint8)
    if kind == "obj":
        colors[:, 3] = 255
    data = MESH_WRITERS[kind].file(mesh.vertices, mesh.faces, colors)
    read = read_mesh(data, f"a.{kind}")
    assert read.colors is not None
    assert np.array_equal(read.colors, colors)
    assert np.array_equal(read.faces, mesh.faces)


def test_stl_and_meshes_without_colours_are_written_as_before() -> None:
    mesh = painted()
    assert MESH_WRITERS["stl"].file(mesh.vertices, mesh.faces, mesh.colors) == MESH_WRITERS["stl"].file(
        mesh.vertices, mesh.faces
    )
    for kind in ("ply", "obj"):
        assert read_mesh(MESH_WRITERS[kind].file(mesh.vertices, mesh.faces), f"a.{kind}").colors is None
    grey = read_mesh(MESH_WRITERS["glb"].file(mesh.vertices, mesh.faces), "a.glb").colors  # of the material
    assert grey is not None
    assert len(np.unique(grey, axis=0)) == 1


def test_other_programs_see_the_same_colours(tmp_path) -> None:
    mesh = painted()
    for kind in ("ply", "obj"):
        (tmp_path / f"a.{kind}").write_bytes(MESH_WRITERS[kind].file(mesh.vertices, mesh.faces, mesh.colors))
        there = trimesh.load(tmp_path / f"a.{kind}", force="mesh", process=False)
        assert np.unique(there.visual.vertex_colors, axis=0).tolist() == [BLUE, RED]


def test_a_completed_mesh_has_the_colours_of_what_it_was_mirrored_from() -> None:
    whole = painted()
    half, *_ = editing.half_of(whole, np.array([1.0, 0, 0, 0]))
    require_painted(half)
    done = complete(half, plane=[1, 0, 0, 0])
    assert done.completion.faces_added > 0
    result = Mesh.checked(done.vertices, done.faces, colors=done.colors)
    assert result.area == pytest.approx(whole.area)
    require_painted(result)


def test_a_cut_through_a_gradient_interpolates_it() -> None:
    vertices = np.array([[-1.0, 0, 0], [1, 0, 0], [0, 2, 0]])
    colors = np.array([[0, 0, 0, 255], [200, 100, 0, 255], [100, 50, 0, 255]], dtype=np.uint8)
    half, *_ = editing.half_of(Mesh.checked(vertices, [[0, 1, 2]], colors=colors), np.array([1.0, 0, 0, 0]))
    assert half.colors is not None
    expected = 100 + 100 * half.vertices[:, 0]
    assert np.abs(half.colors[:, 0] - expected).max() <= 1
    assert np.abs(half.colors[:, 1] - expected / 2).max() <= 1


def test_an_aligned_copy_keeps_its_colours() -> None:
    done = align(painted())
    assert done.colors is not None
    assert np.unique(done.colors, axis=0).tolist() == [BLUE, RED]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 0.5\nf 1 2 3\n", [[255, 0, 0], [0, 255, 0], [0, 0, 128]]),
        ("v 0 0 0 255 0 0\nv 1 0 0 0 9 0\nv 0 1 0 0 0 128\nf 1 2 3\n", [[255, 0, 0], [0, 9, 0], [0, 0, 128]]),
        ("v 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0 0 0 0.5\nf 1 2 3\n", None),  # not of every vertex
        ("v 0 0 0 1\nv 1 0 0 1\nv 0 1 0 1\nf 1 2 3\n", None),  # weights
    ],
)
def test_colours_of_obj_vertices(text: str, expected: list[list[int]] | None) -> None:
    colors = read_mesh(text.encode(), "a.obj").colors
    assert (None if colors is None else colors[:, :3].tolist()) == expected


@pytest.mark.parametrize(
    ("kind", "values"), [("uchar", "255 0 128"), ("float", "1 0 0.502"), ("ushort", "65535 0 32896")]
)
def test_colours_of_ply_vertices(kind: str, values: str) -> None:
    properties = "".join(f"property float {axis}\n" for axis in "xyz")
    properties += "".join(f"property {kind} {name}\n" for name in ("red", "green", "blue"))
    text = f"ply\nformat ascii 1.0\nelement vertex 3\n{properties}element face 1\n"
    text += "property list uchar int vertex_indices\nend_header\n"
    text += "".join(f"{corner} {values}\n" for corner in ("0 0 0", "1 0 0", "0 1 0")) + "3 0 1 2\n"
    colors = read_mesh(text.encode(), "a.ply").colors
    assert colors is not None
    assert colors.tolist() == [[255, 0, 128, 255]] * 3


def test_gltf_colours_are_those_of_vertex_and_material_together() -> None:
    document = Document()
    colour = document.add(np.tile(np.array([255, 128, 0, 255], "<u1"), (4, 1)), U8, "VEC4", normalized=True)
    primitives = [
        {"attributes": {"POSITION": 0, "COLOR_0": colour}, "indices": 1, "material": 0},
        {"attributes": {"POSITION": 0}, "indices": 1, "material": 1},
        {"attributes": {"POSITION": 0}, "indices": 1},
        {"attributes": {"POSITION": 0, "COLOR_0": 99}, "indices": 1, "material": 7},  # broken: only the shape counts
    ]
    materials = [{"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.5]}},
                 {"pbrMetallicRoughness": {"baseColorFactor": [0, 0.2158605, 0, 1]}}]  # fmt: skip
    read = document.read({}, meshes=[{"primitives": primitives}], materials=materials)
    assert read.colors is not None
    seen = [read.colors[face[0]].tolist() for face in read.faces]
    assert seen == [[255, 188, 0, 128], [0, 128, 0, 255], [255] * 4, [255] * 4]
    white = document.read({}, meshes=[{"primitives": primitives[2:3]}])
    assert white.colors is None


def test_light_there_and_back() -> None:
    every = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 4, axis=1)
    assert np.array_equal(from_linear(to_linear(every) / 65535.0), every)
