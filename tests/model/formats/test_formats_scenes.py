"""The formats that hold scenes: glTF, GLB and 3MF."""

import json

import numpy as np
import pytest
import trimesh

from model.formats import read_mesh
from tests.model.mesh_files import XML_TETRAHEDRON, corners_gltf, embedded_gltf, gltf, three_mf


def scene_and_truth():
    """A scene with nested, scaled, mirrored and repeated instances, and its triangles in world coordinates."""
    box, cone = trimesh.creation.box((1, 2, 3)), trimesh.creation.cone(1, 2, sections=9)
    scene = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(0.5, [1, 1, 0], [1, 2, 3])
    mirror = np.diag([1, -1, 1, 1.0])
    scene.graph.update("arm", scene.graph.base_frame, matrix=turn)
    scene.add_geometry(box, geom_name="box", node_name="upper", parent_node_name="arm")
    scene.add_geometry(
        cone, geom_name="cone", node_name="hand", parent_node_name="arm",
        transform=trimesh.transformations.translation_matrix([0, 5, 0]) @ np.diag([2, 2, 3, 1.0]),
    )  # fmt: skip
    scene.graph.update("twin", "arm", matrix=mirror @ turn, geometry="box")
    return scene, scene.to_mesh()


@pytest.mark.parametrize("kind", ["glb", "gltf", "3mf"])
def test_scenes_are_read_in_world_coordinates(kind):
    scene, truth = scene_and_truth()
    data = embedded_gltf(scene) if kind == "gltf" else scene.export(file_type=kind)
    read = read_mesh(data, f"scene.{kind}")
    assert read.area == pytest.approx(truth.area, rel=1e-5)
    assert read.bounds == pytest.approx(truth.bounds, abs=1e-5)
    mine = np.sort(read.vertices[read.faces].mean(axis=1).round(4), axis=0)
    theirs = np.sort(truth.triangles_center.round(4), axis=0)
    assert np.abs(mine - theirs).max() < 2e-4


# --- glTF ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("primitive", "indices", "faces"),
    [
        ({"indices": 1}, [0, 1, 2, 1, 3, 2], [[0, 1, 2], [1, 3, 2]]),
        ({"indices": 1, "mode": 5}, [0, 1, 2, 3], [[0, 1, 2], [2, 1, 3]]),
        ({"indices": 1, "mode": 6}, [0, 1, 3, 2], [[0, 1, 3], [0, 3, 2]]),
        ({"mode": 5}, [], [[0, 1, 2], [2, 1, 3]]),
        ({}, [], [[0, 1, 2]]),
    ],
)
def test_gltf_primitive_modes(primitive, indices, faces):
    assert read_mesh(corners_gltf(primitive, indices), "a.gltf").faces.tolist() == faces


def test_gltf_points_and_lines_are_passed_over():
    data = json.loads(corners_gltf({"indices": 1}, [0, 1, 2]))
    data["meshes"][0]["primitives"] += [{"attributes": {"POSITION": 0}, "mode": mode} for mode in (0, 1, 2, 3)]
    read = read_mesh(json.dumps(data).encode(), "a.gltf")
    assert read.faces.tolist() == [[0, 1, 2]]


def test_gltf_node_transforms():
    half = np.sqrt(0.5)
    nodes = [
        {"children": [1, 2], "translation": [10, 0, 0]},
        {"mesh": 0, "rotation": [0, 0, half, half], "scale": [2, 3, 4]},  # a quarter turn about z after scaling
        {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 5, 1]},  # column by column
    ]
    read = read_mesh(corners_gltf({"indices": 1}, [0, 1, 2], nodes=nodes), "a.gltf")
    expected = [[10, 0, 0], [10, 2, 0], [7, 0, 0], [10, 0, 5], [11, 0, 5], [10, 1, 5]]
    assert read.vertices[read.faces].reshape(-1, 3) == pytest.approx(np.array(expected, dtype=float), abs=1e-6)


def test_gltf_only_the_default_scene_counts():
    nodes = [{"mesh": 0}, {"mesh": 0, "translation": [0, 0, 9]}]
    scenes = [{"nodes": [0]}, {"nodes": [1]}]
    read = read_mesh(corners_gltf({"indices": 1}, [0, 1, 2], nodes=nodes, scenes=scenes, scene=1), "a.gltf")
    assert read.bounds[:, 2].tolist() == [9, 9]


def test_gltf_strided_quantised_and_sparse_accessors():
    records = np.zeros(4, dtype=[("normal", "<i1", 4), ("position", "<i2", 3), ("pad", "<i2")])
    records["position"] = [[0, 0, 0], [32767, 0, 0], [0, 32767, 0], [-32768, 0, 0]]
    changes = np.array([2], dtype="<u4").tobytes() + np.array([0, -32767, 0, 0], dtype="<i2").tobytes()
    accessor = {
        "bufferView": 0, "byteOffset": 4, "componentType": 5122, "normalized": True, "count": 4, "type": "VEC3",
        "sparse": {
            "count": 1,
            "indices": {"bufferView": 1, "componentType": 5125},
            "values": {"bufferView": 1, "byteOffset": 4},
        },
    }  # fmt: skip
    buffer = records.tobytes() + changes
    views = [{"byteLength": 48, "byteStride": 12}, {"byteOffset": 48, "byteLength": 12}]
    data = gltf(buffer, [accessor], views, [{"attributes": {"POSITION": 0}, "mode": 5}])
    read = read_mesh(data, "a.gltf")
    assert read.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, -1, 0], [-1, 0, 0]]


# --- 3MF ----------------------------------------------------------------------------------------------------


def test_3mf_components_and_build_transforms():
    objects = (
        f"<object id='1'><mesh>{XML_TETRAHEDRON}</mesh></object>"
        "<object id='2'><components><component objectid='1'/>"
        "<component objectid='1' transform='2 0 0 0 2 0 0 0 2 10 0 0'/></components></object>"
    )
    # Row vectors: a quarter turn about z (x to y), then a shift by 100 along z.
    read = read_mesh(three_mf(objects, "<item objectid='2' transform='0 1 0 -1 0 0 0 0 1 0 0 100'/>"), "a.3mf")
    assert len(read.faces) == 8
    assert read.units == "millimeter"
    assert read.bounds.tolist() == [[-2, 0, 100], [0, 12, 102]]
    assert read.watertight


def test_3mf_only_what_is_built_counts_and_supports_do_not():
    objects = "".join(
        f"<object id='{number}' type='{kind}'><mesh>{XML_TETRAHEDRON}</mesh></object>"
        for number, kind in ((1, "model"), (2, "model"), (3, "support"))
    )
    assert len(read_mesh(three_mf(objects, "<item objectid='1'/><item objectid='3'/>"), "a.3mf").faces) == 4


def test_3mf_objects_in_another_part():
    core = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
    part = (
        f"<model xmlns='{core}'><resources><object id='1'><mesh>{XML_TETRAHEDRON}</mesh></object></resources></model>"
    )
    item = "<item objectid='1' p:path='/3D/part.model'/>"
    assert len(read_mesh(three_mf("", item, **{"3D/part.model": part}), "a.3mf").faces) == 4


def volume(mesh):
    corners = mesh.vertices[mesh.faces]
    return np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0


def test_what_mirrors_a_body_does_not_turn_it_inside_out():
    box = trimesh.creation.box((1, 2, 3))
    box.apply_translation((2, 0, 0))
    scene = trimesh.Scene(box)
    scene.add_geometry(box, transform=np.diag([-1.0, 1.0, 1.0, 1.0]))
    for kind in ("glb", "3mf"):
        mesh = read_mesh(scene.export(file_type=kind), f"a.{kind}")
        assert mesh.bounds[:, 0].tolist() == [-2.5, 2.5]
        assert volume(mesh) == pytest.approx(12.0)
