"""glTF: the surface where a viewer shows it. Skins, morph targets, instances, visibility, compression, other files."""

import json

import DracoPy
import numpy as np
import pytest
import trimesh

from model.errors import MeshTooLargeError, UnreadableMeshError, UnsupportedFormatError
from model.formats import read_mesh
from model.formats._meshopt import decode_view
from model.formats.conversion import as_mesh, files_at_hand
from tests.app.fakes import DATA
from tests.model.mesh_files import CORNERS, corners_gltf, embedded_gltf, gltf, sample

TRIANGLE = {"indices": 1}
F32, U8, U16 = 5126, 5121, 5123


class Document:
    """A file whose accessors are added one by one; position 0, index 1."""

    def __init__(self, **more):
        self.data = bytearray()
        self.views, self.accessors, self.more = [], [], more
        self.add(CORNERS, F32, "VEC3")
        self.add(np.array([0, 1, 2], "<u2"), U16, "SCALAR")

    def add(self, values, kind, shape, **more):
        self.data += b"\0" * (-len(self.data) % 4)
        self.views.append({"byteOffset": len(self.data), "byteLength": values.nbytes})
        self.data += values.tobytes()
        accessor = {"bufferView": len(self.views) - 1, "componentType": kind, "count": len(values), "type": shape}
        self.accessors.append(accessor | more)
        return len(self.accessors) - 1

    def read(self, primitive, *, looks=False, **more):
        data = gltf(
            bytes(self.data), self.accessors, self.views, [{"attributes": {"POSITION": 0}, **primitive}], **more
        )
        return read_mesh(data, "a.gltf", looks=looks)


def corners(mesh):
    return mesh.vertices[mesh.faces].reshape(-1, 3)


HALF = np.sqrt(0.5)
QUARTER = [0, 0, HALF, HALF]  # about z


def skinned(weights_kind=F32, joints=((0,), (0,), (0,), (0,)), weights=((1,), (1,), (1,), (1,))):
    """The corners bound to joints 1 (moved along x, turned by a quarter) and 2 (moved along z)."""
    document = Document()
    which = np.zeros((4, 4), "<u1")
    much = np.zeros((4, 4), "<f4")
    for row, (ids, shares) in enumerate(zip(joints, weights, strict=True)):
        which[row, : len(ids)], much[row, : len(shares)] = ids, shares
    inverse = np.tile(np.eye(4, dtype="<f4"), (2, 1, 1))
    inverse[0, 3, :3] = -1, 0, 0  # column by column: the first joint was bound at x = 1
    attributes = {"POSITION": 0, "JOINTS_0": document.add(which, U8, "VEC4")}
    if weights_kind == U8:
        attributes["WEIGHTS_0"] = document.add(np.rint(much * 255).astype("<u1"), U8, "VEC4", normalized=True)
    else:
        attributes["WEIGHTS_0"] = document.add(much, F32, "VEC4")
    bind = document.add(inverse.reshape(2, 16), F32, "MAT4")
    nodes = [
        {"mesh": 0, "skin": 0, "translation": [99, 99, 99]},  # of a skinned mesh the node's own place plays no role
        {"translation": [5, 0, 0], "rotation": QUARTER},
        {"translation": [0, 0, 3]},
    ]
    return document.read(
        {"attributes": attributes, "indices": 1},
        nodes=nodes,
        scenes=[{"nodes": [0, 1, 2]}],
        skins=[{"joints": [1, 2], "inverseBindMatrices": bind}],
    )


@pytest.mark.parametrize("kind", [F32, U8])
def test_a_skin_is_read_at_the_pose_of_its_joints(kind):
    # (x, y, 0), first to (x - 1, y, 0), then turned to (-y, x - 1, 0), then moved to (5 - y, x - 1, 0).
    assert corners(skinned(kind)) == pytest.approx(np.array([[5, -1, 0], [5, 0, 0], [4, -1, 0]]), abs=1e-6)


def test_a_skin_blends_its_joints_and_weights_are_made_to_add_up():
    moved = corners(skinned(joints=((0, 1), (1,), (1,), (1,)), weights=((2, 2), (1,), (0.5,), (1,))))
    assert moved == pytest.approx(np.array([[2.5, -0.5, 1.5], [1, 0, 3], [0, 1, 3]]), abs=1e-6)


def test_a_vertex_bound_to_a_joint_that_does_not_exist_is_an_error():
    with pytest.raises(UnreadableMeshError, match="joint"):
        skinned(joints=((0,), (7,), (0,), (0,)))


@pytest.mark.parametrize(
    ("mesh", "node", "far"),
    [({"weights": [1.0]}, {}, 3.0), ({"weights": [1.0]}, {"weights": [0.25]}, 1.5), ({}, {}, 1.0)],
)
def test_morph_targets_stand_at_their_weights(mesh, node, far):
    document = Document()
    target = document.add(np.array([[0, 0, 0], [2, 0, 0], [0, 0, 0], [0, 0, 0]], "<f4"), F32, "VEC3")
    primitive = {"attributes": {"POSITION": 0}, "indices": 1, "targets": [{"POSITION": target}]}
    nodes = [{"mesh": 0, **node}]
    read = document.read({}, meshes=[{"primitives": [primitive], **mesh}], nodes=nodes)
    assert read.bounds[:, 0].tolist() == [0.0, far]


def test_hidden_nodes_and_what_hangs_on_them_are_no_part_of_the_shape():
    hidden = {"KHR_node_visibility": {"visible": False}}
    nodes = [
        {"mesh": 0, "extensions": {"KHR_node_visibility": {"visible": True}}},
        {"mesh": 0, "translation": [50, 0, 0], "extensions": hidden, "children": [2]},
        {"mesh": 0, "extensions": {"KHR_node_visibility": {"visible": True}}},
    ]
    read = read_mesh(corners_gltf(TRIANGLE, [0, 1, 2], nodes=nodes, scenes=[{"nodes": [0, 1]}]), "a.gltf")
    assert read.bounds[:, 0].tolist() == [0.0, 1.0]
    assert len(read.faces) == 1


def instanced(**more):
    document = Document()
    attributes = {
        "TRANSLATION": document.add(np.array([[0, 0, 0], [10, 0, 0]], "<f4"), F32, "VEC3"),
        "ROTATION": document.add(np.array([[0, 0, 0, 1], QUARTER], "<f4"), F32, "VEC4"),
        "SCALE": document.add(np.array([[1, 1, 1], [2, 3, 1]], "<f4"), F32, "VEC3"),
    }
    node = {"mesh": 0, "translation": [0, 0, 7], "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}}
    primitives = [{"attributes": {"POSITION": 0}, **TRIANGLE}]
    data = gltf(
        bytes(document.data), document.accessors, document.views, primitives, nodes=[node],
        extensionsRequired=["EXT_mesh_gpu_instancing"],
    )  # fmt: skip
    return read_mesh(data, "a.gltf", **more)


def test_instances_are_placed():
    expected = [[0, 0, 7], [1, 0, 7], [0, 1, 7], [10, 0, 7], [10, 2, 7], [7, 0, 7]]
    assert corners(instanced()) == pytest.approx(np.array(expected, dtype=float), abs=1e-6)
    with pytest.raises(MeshTooLargeError):
        instanced(max_nodes=2)
    with pytest.raises(MeshTooLargeError):
        instanced(max_faces=1)


def test_instances_that_only_have_numbers_stand_where_their_node_stands():
    document = Document()
    attributes = {"_ID": document.add(np.arange(3, dtype="<f4"), F32, "SCALAR")}
    nodes = [
        {"mesh": 0, "translation": [0, 0, 7], "extensions": {"EXT_mesh_gpu_instancing": {"attributes": attributes}}}
    ]
    assert corners(document.read(TRIANGLE, nodes=nodes)).tolist() == [[0, 0, 7], [1, 0, 7], [0, 1, 7]] * 3


def test_quantised_positions_are_read_as_they_are_stored():
    positions = np.array([[0, 0, 0, 0], [100, 0, 0, 0], [0, 100, 0, 0]], "<u2")
    accessor = {"bufferView": 0, "componentType": U16, "count": 3, "type": "VEC3"}
    data = gltf(
        positions.tobytes(), [accessor], [{"byteLength": 24, "byteStride": 8}], [{"attributes": {"POSITION": 0}}],
        nodes=[{"mesh": 0, "scale": [0.01, 0.01, 0.01]}], extensionsRequired=["KHR_mesh_quantization"],
    )  # fmt: skip
    assert read_mesh(data, "a.gltf").bounds == pytest.approx(np.array([[0, 0, 0], [1, 1, 0]]))


def test_an_extension_that_is_required_and_not_known_is_refused_by_name_of_none():
    with pytest.raises(UnsupportedFormatError, match="requires an extension") as caught:
        read_mesh(corners_gltf(TRIANGLE, [0, 1, 2], extensionsRequired=["ACME_shape"]), "a.gltf")
    assert "ACME" not in str(caught.value)
    for harmless in ({"extensionsUsed": ["ACME_shape"]}, {"extensionsRequired": ["KHR_materials_unlit"]}):
        assert len(read_mesh(corners_gltf(TRIANGLE, [0, 1, 2], **harmless), "a.gltf").faces) == 1


def test_what_is_passed_over_is_told():
    data = json.loads(corners_gltf(TRIANGLE, [0, 1, 2], scenes=[{"nodes": [0]}, {"nodes": [0]}]))
    data["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}, "mode": 1})
    warnings = " ".join(read_mesh(json.dumps(data).encode(), "a.gltf").warnings)
    assert "2 scenes" in warnings
    assert "points or lines" in warnings


def draco_gltf():
    mesh = sample()
    data = DracoPy.encode(mesh.vertices.astype(np.float32), mesh.faces.astype(np.uint32), quantization_bits=20)
    accessors = [
        {"componentType": F32, "count": len(mesh.vertices), "type": "VEC3"},
        {"componentType": U16, "count": mesh.faces.size, "type": "SCALAR"},
    ]
    extension = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}
    primitive = {"attributes": {"POSITION": 0}, "indices": 1, "extensions": extension}
    required = ["KHR_draco_mesh_compression"]
    return mesh, gltf(data, accessors, [{"byteLength": len(data)}], [primitive], extensionsRequired=required)


def test_draco_is_decoded():
    mesh, data = draco_gltf()
    read = read_mesh(data, "a.gltf")
    assert len(read.faces) == len(mesh.faces)
    assert read.area == pytest.approx(mesh.area, rel=1e-4)
    assert read.bounds == pytest.approx(mesh.bounds, abs=1e-4)
    broken = json.loads(data)
    broken["bufferViews"][0]["byteLength"] //= 2
    with pytest.raises(UnreadableMeshError, match="Draco"):
        read_mesh(json.dumps(broken).encode(), "a.gltf")


@pytest.mark.parametrize("name", ["torus_meshopt.glb", "torus_meshopt_exponential.glb"])
def test_meshopt_is_decoded(name):
    torus = trimesh.creation.torus(2, 0.5, major_sections=24, minor_sections=12)
    torus.apply_transform(trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [4, 5, 6]))
    read = read_mesh((DATA / name).read_bytes(), name)
    assert len(read.faces) == len(torus.faces)
    assert read.watertight
    assert read.area == pytest.approx(torus.area, rel=1e-4)
    assert read.bounds == pytest.approx(torus.bounds, abs=5e-4)


def test_damaged_meshopt_is_a_mesh_error_whatever_the_damage():
    data = (DATA / "torus_meshopt.glb").read_bytes()
    rng = np.random.default_rng(8)
    failed = 0
    for _ in range(200):
        damaged = bytearray(data)
        for place in rng.integers(1200, len(data), 3):
            damaged[place] = rng.integers(256)
        try:
            read = read_mesh(bytes(damaged), "a.glb", max_faces=10_000, max_vertices=10_000)
            assert read.faces.max() < len(read.vertices)
        except (UnreadableMeshError, UnsupportedFormatError, MeshTooLargeError):
            failed += 1
    assert failed > 20


def test_meshopt_sequences_of_indices():
    values = [3, 4, 5, 1000, 6, 1001, 70000, 0]
    coded, last = bytearray([0xD1]), [0, 0]
    for value in values:
        baseline = value > 500
        step = value - last[baseline]
        last[baseline] = value
        number = ((step << 1) ^ (step >> 63)) << 1 | baseline
        while number > 127:
            coded.append(number & 127 | 128)
            number >>= 7
        coded.append(number)
    view = {"count": len(values), "byteStride": 4, "mode": "INDICES"}
    assert np.frombuffer(decode_view(view, bytes(coded) + b"\0" * 4), "<u4").tolist() == values


# --- files beside -------------------------------------------------------------------------------------------


def separate(folder=""):
    """A glTF file and its buffer, as two files."""
    mesh = sample()
    document = json.loads(embedded_gltf(trimesh.Scene(mesh)))
    files = trimesh.Scene(mesh).export(file_type="gltf")
    contents = [files[name] for name in files if name.endswith(".bin")]
    for number, buffer in enumerate(document["buffers"]):
        buffer["uri"] = f"{folder}my%20buffer%20{number}.bin"
    return mesh, json.dumps(document).encode(), {f"my buffer {i}.bin": data for i, data in enumerate(contents)}


def test_buffers_in_other_files_are_found_by_name():
    mesh, data, files = separate("data/")
    read = read_mesh(data, "a.gltf", resources=files_at_hand({name.upper(): file for name, file in files.items()}))
    assert read.area == pytest.approx(mesh.area, rel=1e-5)
    with pytest.raises(UnreadableMeshError, match="both in one upload"):
        read_mesh(data, "a.gltf")
    pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"
    with pytest.raises(UnreadableMeshError, match="git lfs pull"):
        read_mesh(data, "a.gltf", resources=files_at_hand(dict.fromkeys(files, pointer)))


def test_a_path_brings_the_files_of_its_folder_and_no_others(tmp_path):
    mesh, data, files = separate("data/")
    (tmp_path / "in" / "data").mkdir(parents=True)
    (tmp_path / "in" / "a.gltf").write_bytes(data)
    for name, content in files.items():
        (tmp_path / "in" / "data" / name).write_bytes(content)
    assert as_mesh(tmp_path / "in" / "a.gltf").area == pytest.approx(mesh.area, rel=1e-5)
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    (tmp_path / "in" / "b.gltf").write_bytes(data.replace(b"data/", b"../"))
    with pytest.raises(UnreadableMeshError):
        as_mesh(tmp_path / "in" / "b.gltf")
    (tmp_path / "in" / "c.gltf").write_bytes(data.replace(b"data/", str(tmp_path).encode() + b"/"))
    with pytest.raises(UnreadableMeshError):
        as_mesh(tmp_path / "in" / "c.gltf")
