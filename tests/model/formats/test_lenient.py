"""Files with faults that a person would read past: read past, and told; and files that are none, with a way out."""

import gzip
import struct

import numpy as np
import pytest
import trimesh

from model.errors import DegenerateMeshError, MeshError, UnreadableMeshError, UnsupportedFormatError
from model.formats import read_mesh
from tests.model.mesh_files import SQUARE, archive, export, sample

# --- lines and words ----------------------------------------------------------------------------------------

TEXTS = ["stl_ascii", "obj", "ply_ascii", "off"]


@pytest.mark.parametrize("kind", TEXTS)
@pytest.mark.parametrize("ending", [b"\r", b"\r\n"])
def test_lines_may_end_as_on_any_system(kind, ending):
    data, name = export(sample(), kind), f"a.{kind.split('_')[0]}"
    expected, read = read_mesh(data, name), read_mesh(data.replace(b"\n", ending), name)
    assert np.array_equal(read.vertices, expected.vertices)
    assert np.array_equal(read.faces, expected.faces)


@pytest.mark.parametrize("kind", TEXTS)
@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be", "utf-8"])
def test_text_may_have_letters_of_16_bits(kind, encoding):
    text, name = export(sample(), kind).decode(), f"a.{kind.split('_')[0]}"
    expected = read_mesh(text.encode(), name)
    read = read_mesh(("\ufeff" + text).encode(encoding), name)
    assert np.array_equal(read.vertices, expected.vertices)
    assert np.array_equal(read.faces, expected.faces)
    binary = b"\xff\xfe" + export(sample(), "stl")[2:]  # the header of a binary STL may begin with anything
    assert len(read_mesh(binary, "a.stl").faces) == len(expected.faces)


@pytest.mark.parametrize("kind", TEXTS)
def test_decimal_commas_are_named(kind):
    mesh = trimesh.creation.box((1.5, 2.5, 3.5))
    with pytest.raises(UnreadableMeshError, match="decimal commas"):
        read_mesh(export(mesh, kind).replace(b".", b","), f"a.{kind.split('_')[0]}")


@pytest.mark.parametrize(
    ("first", "last"),
    [
        ("solid vertex", "endsolid vertex"),
        ("solid a vertex b", "endsolid a vertex b"),
        ("solid vertex 1 2 3", "endsolid"),
        ("SOLID facet", "EndSolid vertex 1"),
        ("solid", "endsolid vertex 0 0 0\nsolid vertex"),
    ],
)
def test_a_solid_may_have_any_name(first, last):
    facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    read = read_mesh(f"{first}\n{facet}{last}\n{facet}endsolid\n".encode(), "a.stl")
    assert read.faces.tolist() == [[0, 1, 2], [3, 4, 5]]


def ply_text(vertices, faces, face_properties=""):
    return (
        f"ply\nformat ascii 1.0\nelement vertex {len(vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\n{face_properties}end_header\n"
        + "\n".join([*vertices, *faces])
        + "\n"
    ).encode()


TETRAHEDRON = ["0 0 0", "1 0 0", "0 1 0", "0 0 1"]
SIDES = ["3 0 2 1", "3 0 1 3", "3 0 3 2", "3 1 2 3"]


def test_ply_rows_longer_than_announced():
    expected = read_mesh(ply_text(TETRAHEDRON, SIDES), "a.ply")
    assert expected.warnings == ()
    for vertices, faces, lines in (
        (TETRAHEDRON, [f"{side} 255 0 0" for side in SIDES], 4),
        ([f"{corner} 0.5 0.5" for corner in TETRAHEDRON], SIDES, 4),
        ([*TETRAHEDRON[:3], "0 0 1 7"], [*SIDES[:3], "3 1 2 3 9"], 2),
    ):
        read = read_mesh(ply_text(vertices, faces), "a.ply")
        assert np.array_equal(read.vertices, expected.vertices)
        assert np.array_equal(read.faces, expected.faces)
        (warning,) = read.warnings
        assert warning.startswith(f"{lines} lines hold more")


def test_ply_rows_broken_over_lines_are_still_read():
    text = ply_text(TETRAHEDRON, [side.replace(" ", "\n", 1) for side in SIDES], "property uchar red\n")
    text = text.replace(b"2 1\n", b"2 1 7\n").replace(b"1 3\n", b"1 3\n7\n").replace(b"3 2\n", b"3 2 7\n")
    text = text.replace(b"1 2 3\n", b"1 2 3 7\n")
    assert read_mesh(text, "a.ply").faces.tolist() == [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]


# --- broken faces -------------------------------------------------------------------------------------------


def sphere_with(broken, fault):
    """A sphere in which some vertices are not finite, or some faces refer to none."""
    mesh = trimesh.creation.icosphere(3)
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces)
    if fault == "index":
        faces[:broken, 1] = len(vertices) + 5
    else:
        vertices[:broken, 1] = fault
    return vertices, faces


def as_file(vertices, faces, kind):
    rows = [" ".join(map(repr, row)) for row in vertices.tolist()]
    corners = [" ".join(map(str, face)) for face in faces.tolist()]
    if kind == "obj":
        corners = [" ".join(str(i + 1) for i in face) for face in faces.tolist()]
        return ("".join(f"v {row}\n" for row in rows) + "".join(f"f {face}\n" for face in corners)).encode()
    if kind == "off":
        return "\n".join([f"OFF\n{len(rows)} {len(corners)} 0", *rows, *(f"3 {face}" for face in corners)]).encode()
    if kind == "ply":
        return ply_text(rows, [f"3 {face}" for face in corners])
    records = np.zeros(len(faces), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("rest", "<u2")])
    records["corners"] = vertices[faces]
    return b"\0" * 80 + struct.pack("<I", len(faces)) + records.tobytes()


@pytest.mark.parametrize(
    ("kind", "fault"),
    [(kind, fault) for kind in ("obj", "off", "ply", "stl") for fault in ("index", np.nan, np.inf)
     if (kind, fault) != ("stl", "index")],
)  # fmt: skip
def test_a_few_broken_faces_are_left_out_and_counted(kind, fault):
    vertices, faces = sphere_with(3, fault)
    bad = (faces >= len(vertices)).any(axis=1) | ~np.isfinite(vertices[faces % len(vertices)]).all(axis=(1, 2))
    read = read_mesh(as_file(vertices, faces, kind), f"a.{kind}")
    assert len(read.faces) == len(faces) - bad.sum()
    (warning,) = read.warnings
    assert warning.startswith(f"{bad.sum()} faces were left out")
    corners = read.vertices[read.faces]
    assert np.isfinite(corners).all()
    assert np.abs(np.linalg.norm(corners, axis=2) - 1.0).max() < 1e-6


@pytest.mark.parametrize(("fault", "words"), [("index", "does not exist"), (np.nan, "finite")])
def test_many_broken_faces_are_an_error(fault, words):
    with pytest.raises(DegenerateMeshError, match=words):
        read_mesh(as_file(*sphere_with(300, fault), "ply"), "a.ply")


def test_vertices_that_no_face_uses_change_nothing():
    read = read_mesh(f"v 1e9 nan 7\n{SQUARE}v 5 5 5\nf 2 3 4 5\n".encode(), "a.obj")
    assert read.bounds.tolist() == [[0, 0, 0], [1, 1, 0]]
    assert read.warnings == ()


# --- resolution ---------------------------------------------------------------------------------------------


def building(origin):
    mesh = trimesh.creation.box((35.0, 30.0, 15.0))
    turn = trimesh.transformations.rotation_matrix(0.3, [0, 0, 1])
    mesh.apply_transform(turn)
    return np.array(mesh.vertices) + origin, np.array(mesh.faces)


@pytest.mark.parametrize("kind", ["stl", "ply"])
def test_32_bits_far_from_the_origin_are_told(kind):
    vertices, faces = building([435_678.0, 5_412_345.0, 310.0])
    if kind == "ply":
        vertices = vertices.astype(np.float32).astype(np.float64)
    (warning,) = read_mesh(as_file(vertices, faces, kind), f"a.{kind}").warnings
    assert "resolve only 0.5 of its" in warning


def test_few_digits_far_from_the_origin_are_told():
    vertices, faces = building([435_678.0, 5_412_345.0, 310.0])
    text = "".join(f"v {x:g} {y:g} {z:g}\n" for x, y, z in vertices)  # as C++ streams write: 5.41234e+06
    text += "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in faces)
    (warning,) = read_mesh(text.encode(), "a.obj").warnings
    assert "resolve only 10 of its" in warning


@pytest.mark.parametrize(
    ("origin", "kind"), [([0, 0, 0], "stl"), ([300, 200, 0], "stl"), ([435_678.0, 5_412_345.0, 310.0], "obj")]
)
def test_enough_digits_are_no_matter(origin, kind):
    assert read_mesh(as_file(*building(origin), kind), f"a.{kind}").warnings == ()


def test_round_numbers_far_from_the_origin_may_be_meant():
    box = trimesh.creation.box((10, 10, 10))
    assert read_mesh(as_file(np.array(box.vertices) + 5000, box.faces, "obj"), "a.obj").warnings == ()


# --- foreign files ------------------------------------------------------------------------------------------

LFS = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"
COLLADA = b'<?xml version="1.0"?>\n<COLLADA xmlns="x" version="1.4.1"><asset/></COLLADA>'


FOREIGN = [
    (LFS, "git lfs pull"),
    (b"<!DOCTYPE html>\n<html><head><title>404</title></head></html>", "web page"),
    (b"\n\n <html lang=en>", "web page"),
    (b"ISO-10303-21;\nHEADER;\n", "STEP"),
    (b"Kaydara FBX Binary  \0\x1a\0" + b"\0" * 100, "FBX"),
    (b"; FBX 7.3.0 project file\n", "FBX"),
    (b"BLENDER-v300" + b"\0" * 40, "Blender"),
    (COLLADA, "Collada"),
    (b"#usda 1.0\n", "USD"),
    (gzip.compress(b"solid", mtime=0), "gzip"),
    (b"%PDF-1.7", "PDF"),
    (b"<!-- cached -->\n<!DOCTYPE html><html></html>", "web page"),
    (b'<?xml version="1.0"?><html xmlns="http://www.w3.org/1999/xhtml"></html>', "web page"),
    (b'<?xml version="1.0"?><Error><Code>AccessDenied</Code></Error>', "message of the server"),
    (b'{"message": "Not Found", "status": "404"}', "message of the server"),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1" + b"\0" * 90, "CAD"),
    (b"exported by hand".ljust(72) + b"S      1\r\n", "IGES"),
    (b"\x89PNG\r\n\x1a\n" + b"\0" * 90, "picture"),
    (archive("x").replace(b"3D/3dmodel.model", b"parts/mine.usdc0"), "zip archive without"),
]


@pytest.mark.parametrize(("data", "words"), FOREIGN, ids=[words for _, words in FOREIGN])
@pytest.mark.parametrize("name", ["a.stl", "a.obj", "a.glb", "a.ply", "a.3mf"])
def test_other_files_under_a_known_name_are_called_what_they_are(data, words, name):
    with pytest.raises(UnsupportedFormatError, match=words) as caught:
        read_mesh(data, name)
    assert "." in str(caught.value).split(words)[-1]  # and what to do about it


def test_a_message_under_the_name_of_gltf_is_told():
    with pytest.raises(UnreadableMeshError, match="message of the server"):
        read_mesh(b'{"message": "Not Found", "status": "404"}', "a.gltf")


def zipped(*names):
    data = archive("x", **dict.fromkeys(names, "content"))
    return data.replace(b"3D/3dmodel.model", b"3D/notes_only.tx")


@pytest.mark.parametrize(
    ("names", "words"),
    [
        (("a/chair.obj", "a/chair.mtl"), "one mesh, in OBJ"),
        (("a.stl", "b.stl", "__MACOSX/._a.stl"), "holds 2 meshes"),
        (("readme.md",), "without a mesh"),
        (("x.usdc", "0.png"), "USDZ"),
    ],
)
def test_archives_are_told_apart(names, words):
    with pytest.raises(UnsupportedFormatError, match=words):
        read_mesh(zipped(*names), "a.stl")


@pytest.mark.parametrize(
    ("extension", "words"),
    [("step", "FreeCAD"), ("igs", "FreeCAD"), ("fbx", "Blender"), ("blend", "Blender"), ("dae", "Blender"),
     ("usdz", "Blender"), ("gz", "Unpack"), ("laz", "points"), ("mtl", "materials"),
     ("bin", "gltf")],
)  # fmt: skip
def test_unsupported_extensions_come_with_the_next_step(extension, words):
    with pytest.raises(UnsupportedFormatError, match=words):
        read_mesh(b"anything", f"a.{extension}")


def test_good_files_are_never_called_foreign():
    for kind in ("stl", "obj", "ply", "off", "glb", "gltf", "3mf"):
        read_mesh(export(sample(), kind), f"a.{kind}")
    html = b"<html".ljust(80, b" ")  # the header of a binary STL is free text
    assert read_mesh(html + export(sample(), "stl")[80:], "a.stl").faces.shape[1] == 3
    with pytest.raises(MeshError):
        read_mesh(b"PK\x03\x04" + b"\0" * 50, "a.3mf")
