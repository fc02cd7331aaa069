"""Files that are damaged, hostile, misnamed or too large: the error says which, and nothing else ever escapes."""

import json
import struct

import numpy as np
import pytest

from model.errors import (
    DegenerateMeshError,
    EmptyMeshError,
    MeshError,
    MeshTooLargeError,
    UnreadableMeshError,
    UnsupportedFormatError,
)
from model.formats import FORMATS, read_mesh
from tests.model.mesh_files import (
    BUILD,
    KINDS,
    SQUARE,
    XML_TETRAHEDRON,
    archive,
    corners_gltf,
    export,
    sample,
    three_mf,
)

TRIANGLE_PLY = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
)


@pytest.mark.parametrize("kind", KINDS)
def test_truncated_and_altered_files_only_raise_mesh_errors(kind):
    data = export(sample(), kind)
    name = f"a.{kind.split('_')[0]}"
    rng = np.random.default_rng(41)
    cuts = [*rng.integers(0, len(data), 25), *range(0, 120, 9)]
    damaged = [data[:cut] for cut in cuts]
    for _ in range(120):
        copy = bytearray(data)
        # Half of the damage near the start, where the counts and the structure are.
        reach = len(data) if rng.random() < 0.5 else min(len(data), 400)
        for place in rng.integers(0, reach, rng.integers(1, 6)):
            copy[place] = rng.integers(256) if rng.random() < 0.5 else copy[place] ^ (1 << rng.integers(8))
        damaged.append(bytes(copy))
    read = 0
    for content in damaged:
        try:
            mesh = read_mesh(content, name)
        except MeshError:
            continue
        read += 1
        assert np.isfinite(mesh.bounds).all()
        assert mesh.faces.min() >= 0
        assert mesh.faces.max() < len(mesh.vertices)
    assert read < len(damaged)


@pytest.mark.parametrize("kind", ["stl", "obj", "ply", "off", "glb", "gltf", "3mf"])
@pytest.mark.parametrize("content", [b"", b"\0", b"\n\n", b"hello world", bytes(range(256)) * 4, b"\xff" * 500])
def test_anything_else_is_a_mesh_error(kind, content):
    with pytest.raises(MeshError):
        read_mesh(content, f"a.{kind}")


@pytest.mark.parametrize("name", ["a.step", "a.fbx", "a", "a.obj.gz", ".obj", "a.mtl", ""])
def test_unknown_extensions_list_the_known_ones(name):
    with pytest.raises(UnsupportedFormatError, match="STL, OBJ, PLY, OFF, GLB, glTF, 3MF"):
        read_mesh(b"v 0 0 0", name)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("named", ["stl", "obj", "ply", "off", "glb", "gltf", "3mf"])
def test_a_misnamed_file_is_recognised(kind, named):
    actual = kind.split("_")[0]
    if actual == named:
        return
    data = export(sample(), kind)
    if kind == "stl":  # a binary STL shows nothing for certain, except to its own reader
        with pytest.raises(MeshError):
            read_mesh(data, f"a.{named}")
    else:
        with pytest.raises(UnsupportedFormatError, match=f"contains {FORMATS[actual].label}"):
            read_mesh(data, f"a.{named}")


@pytest.mark.parametrize("kind", KINDS)
def test_limits_hold_for_every_format(kind):
    mesh = sample()
    name, data = f"a.{kind.split('_')[0]}", export(mesh, kind)
    with pytest.raises(MeshTooLargeError, match="faces"):
        read_mesh(data, name, max_faces=len(mesh.faces) - 1)
    with pytest.raises(MeshTooLargeError, match="vertices"):
        read_mesh(data, name, max_vertices=20)
    assert len(read_mesh(data, name, max_faces=len(mesh.faces), max_vertices=10_000).faces) == len(mesh.faces)


def glb_of(text):
    text += b" " * (-len(text) % 4)
    return struct.pack("<4sII", b"glTF", 2, 20 + len(text)) + struct.pack("<I4s", len(text), b"JSON") + text


def changed_gltf(change):
    document = json.loads(corners_gltf({"indices": 1}, [0, 1, 2]))
    change(document)
    return json.dumps(document).encode()


def set_uri(document):
    document["buffers"][0]["uri"] = "file:///etc/passwd"


def add_parent(document):
    document["nodes"] += [{"children": [0]}, {"children": [0]}]
    document["scenes"][0]["nodes"] = [1, 2]


def make_cycle(document):
    document["nodes"][0]["children"] = [0]


def ask_for_much(document):
    document["accessors"][0].update(count=10**12)


def ask_for_zeros(document):
    document["accessors"][0].update(count=10**9)
    del document["accessors"][0]["bufferView"]


def point_backwards(document):
    document["accessors"][0].update(byteOffset=-12)


@pytest.mark.parametrize(
    ("name", "data", "error", "words"),
    [
        ("a.obj", SQUARE + "f 1 2 9\n", DegenerateMeshError, "does not exist"),
        ("a.obj", SQUARE + "f 1 2 -9\n", DegenerateMeshError, "does not exist"),
        ("a.obj", SQUARE + "f 1 2 99999999999999999999\n", DegenerateMeshError, "does not exist"),
        ("a.obj", SQUARE + "f 0 1 2\n", UnreadableMeshError, "number 0"),
        ("a.obj", SQUARE + "f a b c\n", UnreadableMeshError, "face"),
        ("a.obj", SQUARE + "f 1.5 2 3\n", UnreadableMeshError, "face"),
        ("a.obj", "v 1 2\n" + SQUARE + "f 1 2 3\n", UnreadableMeshError, "vertex"),
        ("a.obj", "v 1 2 x\n" + SQUARE + "f 1 2 3\n", UnreadableMeshError, "vertex"),
        ("a.obj", "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", DegenerateMeshError, "finite"),
        ("a.obj", "v inf 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", DegenerateMeshError, "finite"),
        ("a.obj", "v 1e999 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", DegenerateMeshError, "finite"),
        ("a.obj", SQUARE, EmptyMeshError, "no faces"),
        ("a.obj", SQUARE + "f 1 1 1\n", DegenerateMeshError, "extent"),
        ("a.obj", SQUARE + "f 1 2 1\n", DegenerateMeshError, "area"),
        ("a.stl", "solid nothing\nendsolid nothing\n", EmptyMeshError, "no faces"),
        ("a.stl", "solid x\nfacet\nvertex 0 0 0\nvertex 1 0 0\nendsolid", UnreadableMeshError, "triangle"),
        ("a.stl", "solid x\nfacet\nvertex 0 0\nendfacet\nendsolid", UnreadableMeshError, "three numbers"),
        ("a.stl", b"\0" * 80 + struct.pack("<I", 2**32 - 1) + b"\0" * 100, UnreadableMeshError, "shorter"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 5\n", DegenerateMeshError, "does not exist"),
        ("a.off", "OFF\n3 1000000000 0\n0 0 0\n1 0 0\n", UnreadableMeshError, "counts"),
        ("a.off", "OFF\n-3 1 0\n0 0 0\n1 0 0\n", UnreadableMeshError, "counts"),
        ("a.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1.5 nan\n", UnreadableMeshError, "index"),
        ("a.off", "OFF BINARY\n....", UnsupportedFormatError, "Binary OFF"),
        ("a.off", "4OFF\n3 1 0\n", UnsupportedFormatError, "four"),
        ("a.ply", TRIANGLE_PLY + "0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n", DegenerateMeshError, "does not exist"),
        ("a.ply", TRIANGLE_PLY + "0 0 0\n1 0 0\n0 1 0\n", UnreadableMeshError, "shorter"),
        ("a.ply", TRIANGLE_PLY + "0 0 0\nnan 0 0\n0 1 0\n3 0 1 2\n", DegenerateMeshError, "finite"),
        ("a.ply", TRIANGLE_PLY.replace("face 1", "face 0") + "0 0 0\n1 0 0\n0 1 0\n", EmptyMeshError, "no faces"),
        ("a.ply", TRIANGLE_PLY.replace("face 1", "face -1"), UnreadableMeshError, "negative"),
        ("a.ply", TRIANGLE_PLY.replace("face 1", "face x"), UnreadableMeshError, "header"),
        ("a.ply", TRIANGLE_PLY.replace("float z", "float w"), UnreadableMeshError, "without x, y or z"),
        ("a.ply", TRIANGLE_PLY.replace("float z", "quad z"), UnreadableMeshError, "header"),
        ("a.ply", TRIANGLE_PLY.replace("format ascii 1.0\n", ""), UnreadableMeshError, "format"),
        ("a.ply", TRIANGLE_PLY.replace("end_header", ""), UnreadableMeshError, "header"),
        (
            "a.ply",
            TRIANGLE_PLY.replace("ascii", "binary_little_endian").replace("vertex 3", "vertex 4000000000"),
            UnreadableMeshError,
            "shorter",
        ),
        ("a.gltf", "{}", UnreadableMeshError, "rules"),
        ("a.gltf", "{" * 100_000, UnreadableMeshError, "JSON"),
        ("a.gltf", '{"a":' * 100_000, UnreadableMeshError, "JSON"),
        ("a.gltf", '{"asset": {"version": "1.0"}}', UnsupportedFormatError, "version 2"),
        ("a.gltf", '{"asset": {"version": "2.0"}}', EmptyMeshError, "no faces"),
        ("a.gltf", changed_gltf(set_uri), UnreadableMeshError, "both in one upload"),
        ("a.gltf", changed_gltf(add_parent), UnreadableMeshError, "parent"),
        ("a.gltf", changed_gltf(make_cycle), UnreadableMeshError, "parent"),
        ("a.gltf", changed_gltf(ask_for_much), UnreadableMeshError, "beyond"),
        ("a.gltf", changed_gltf(ask_for_zeros), UnreadableMeshError, "without data"),
        ("a.gltf", changed_gltf(point_backwards), UnreadableMeshError, "beyond"),
        ("a.gltf", corners_gltf({"indices": 1}, [0, 1, 4]), UnreadableMeshError, "does not exist"),
        ("a.glb", glb_of(b'{"asset": {"version": "2.0"}}'), EmptyMeshError, "no faces"),
        ("a.glb", glb_of(changed_gltf(lambda d: d["buffers"][0].pop("uri"))), UnreadableMeshError, "content"),
        ("a.glb", b"glTF" + struct.pack("<II", 1, 12) + b"\0" * 20, UnsupportedFormatError, "version 2"),
        ("a.3mf", archive("<model><build>"), UnreadableMeshError, "rules"),
        ("a.3mf", archive("<!DOCTYPE a [<!ENTITY b 'c'>]><model/>"), UnreadableMeshError, "document type"),
        ("a.3mf", archive(f"<model><resources/>{BUILD}</model>"), UnreadableMeshError, "does not exist"),
        (
            "a.3mf",
            three_mf(f"<object id='1'><mesh>{XML_TETRAHEDRON.replace('v3=', 'w=')}</mesh></object>", ""),
            UnreadableMeshError,
            "rules",
        ),
        (
            "a.3mf",
            three_mf(
                f"<object id='1'><mesh>{XML_TETRAHEDRON}</mesh></object>",
                "<item objectid='1' p:path='/3D/none.model'/>",
            ),
            UnreadableMeshError,
            "lacks a part",
        ),
        (
            "a.3mf",
            three_mf(
                "<object id='1'><components><component objectid='2'/></components></object>"
                "<object id='2'><components><component objectid='1'/></components></object>",
                "<item objectid='1'/>",
            ),
            UnreadableMeshError,
            "contains itself",
        ),
    ],
)
def test_the_error_names_the_fault(name, data, error, words):
    with pytest.raises(error, match=words):
        read_mesh(data.encode() if isinstance(data, str) else data, name)


def test_instances_are_counted_before_they_are_made():
    nodes = [{"mesh": 0} for _ in range(2000)]
    data = corners_gltf({"indices": 1}, [0, 1, 2], nodes=nodes, scenes=[{"nodes": list(range(2000))}])
    assert len(read_mesh(data, "a.gltf").faces) == 2000
    with pytest.raises(MeshTooLargeError):
        read_mesh(data, "a.gltf", max_faces=1999)


def test_components_that_multiply_are_counted_before_they_are_made():
    objects = f"<object id='0'><mesh>{XML_TETRAHEDRON}</mesh></object>"
    for number in range(1, 60):
        twice = f"<component objectid='{number - 1}'/>" * 2
        objects += f"<object id='{number}'><components>{twice}</components></object>"
    with pytest.raises(MeshTooLargeError):
        read_mesh(three_mf(objects, "<item objectid='59'/>"), "a.3mf")


@pytest.mark.parametrize("honest", [True, False])
def test_a_zip_bomb_stops_early(honest):
    data = archive("<model><metadata>" + " " * (3 << 20) + "</metadata></model>")
    if not honest:  # the directory at the end claims a harmless size
        data = data.replace(struct.pack("<I", (3 << 20) + 36), struct.pack("<I", 1000))
    with pytest.raises(MeshTooLargeError if honest else MeshError):
        read_mesh(data, "a.3mf", max_unpacked_bytes=1 << 20)


def test_messages_never_quote_the_file():
    secret = "s3cr3t"
    for name in ("a.obj", "a.ply", "a.off", "a.stl", "a.gltf", "a.3mf", f"a.{secret}"):
        for text in (f"v {secret}", f"ply\nformat {secret}\nend_header\n", f"OFF {secret}", f'{{"{secret}": 1}}'):
            with pytest.raises(MeshError) as caught:
                read_mesh(text.encode(), name)
            assert secret not in str(caught.value)
