"""Reading: the same mesh out of every format, scene transforms, odd but legal files. Broken files: test_broken_files."""

import base64
import json
import struct
import zipfile
from io import BytesIO

import numpy as np
import pytest
import trimesh

from model.errors import UnsupportedFormatError
from model.formats import SUPPORTED_FORMATS, read_mesh


def sample():
    """A mesh without symmetry, far from the origin, with a hole."""
    mesh = trimesh.creation.torus(2, 0.5, major_sections=14, minor_sections=7)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(0.7, [1, 2, 3], [4, 5, 6]))
    return trimesh.Trimesh(mesh.vertices, mesh.faces[3:], process=False)


def embedded_gltf(scene):
    files = scene.export(file_type="gltf")
    document = json.loads(files["model.gltf"])
    for buffer in document["buffers"]:
        content = base64.b64encode(files[buffer["uri"]]).decode()
        buffer["uri"] = "data:application/octet-stream;base64," + content
    return json.dumps(document).encode()


def export(mesh, kind):
    if kind == "gltf":
        return embedded_gltf(mesh)
    if kind == "ply_ascii":
        data = mesh.export(file_type="ply", encoding="ascii")
    else:
        data = mesh.export(file_type=kind)
    return data.encode() if isinstance(data, str) else data


KINDS = ["stl", "stl_ascii", "obj", "ply", "ply_ascii", "off", "glb", "gltf", "3mf"]


@pytest.mark.parametrize("kind", KINDS)
def test_every_format_gives_the_same_triangles(kind):
    mesh = sample()
    extension = kind.split("_")[0]
    read = read_mesh(export(mesh, kind), f"Some Name.{extension.upper()}")
    assert read.source_format == extension
    assert extension in SUPPORTED_FORMATS
    assert np.abs(read.vertices[read.faces] - mesh.vertices[mesh.faces]).max() < 2e-6  # float32 in most formats


def test_units_are_those_of_the_format():
    mesh = sample()
    assert read_mesh(export(mesh, "glb"), "a.glb").units == "meter"
    assert read_mesh(export(mesh, "obj"), "a.obj").units is None
    model = '<model unit="inch"><resources><object id="1"><mesh>{}</mesh></object></resources>{}</model>'
    assert read_mesh(archive(model.format(XML_TETRAHEDRON, BUILD)), "a.3mf").units == "inch"


def scene_and_truth():
    """A scene with nested, scaled, mirrored and repeated instances, and its triangles in world coordinates."""
    box, cone = trimesh.creation.box((1, 2, 3)), trimesh.creation.cone(1, 2, sections=9)
    scene = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(0.5, [1, 1, 0], [1, 2, 3])
    mirror = np.diag([1, -1, 1, 1.0])
    scene.add_geometry(box, geom_name="box", node_name="arm", transform=turn)
    scene.add_geometry(
        cone, geom_name="cone", node_name="hand", parent_node_name="arm",
        transform=trimesh.transformations.translation_matrix([0, 5, 0]) @ np.diag([2, 2, 3, 1.0]),
    )  # fmt: skip
    scene.graph.update("twin", "arm", matrix=mirror @ turn, geometry="box")
    return scene, scene.to_mesh()


@pytest.mark.parametrize("kind", ["glb", "gltf", "3mf"])
def test_scenes_are_read_in_world_coordinates(kind):
    scene, truth = scene_and_truth()
    if kind == "gltf":
        data = embedded_gltf(scene)
    else:
        data = scene.export(file_type=kind)
    read = read_mesh(data, f"scene.{kind}")
    assert read.area == pytest.approx(truth.area, rel=1e-5)
    assert read.bounds == pytest.approx(truth.bounds, abs=1e-5)
    mine = np.sort(read.vertices[read.faces].mean(axis=1).round(4), axis=0)
    theirs = np.sort(truth.triangles_center.round(4), axis=0)
    assert np.abs(mine - theirs).max() < 2e-4


# --- OBJ ---------------------------------------------------------------------------------------------------------------

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


def faces_of(text, name="a.obj"):
    return read_mesh(text.encode(), name).faces.tolist()


@pytest.mark.parametrize(
    "line",
    ["f 1 2 3 4", "f -4 -3 -2 -1", "f 1/1 2/2 3/3 4/4", "f 1//1 2//1 3//1 4//1", "f 1/1/1 2/2/1 3/3/1 4/4/1",
     "f 1 2 \\\n 3 4", "f\t1\t2 3  4 \r", "  f 1 2 3 4 # a comment", "f 1 2 3 4#", "f 1 2\\\r\n3 4"],
)  # fmt: skip
def test_obj_faces_in_all_spellings(line):
    assert faces_of(f"{SQUARE}{line}\n") == [[0, 1, 2], [0, 2, 3]]
    assert faces_of(f"{SQUARE}{line}") == [[0, 1, 2], [0, 2, 3]]  # without a final line break


def test_obj_negative_indices_count_from_where_they_stand():
    assert faces_of("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 0 0 1\nf -4 -3 -1\n") == [[0, 1, 2], [0, 1, 3]]


def test_obj_ignores_everything_but_geometry():
    text = (
        "\ufeff# v 9 9 9\nmtllib ../../etc/passwd\no first\n" + SQUARE + "vn 0 0 1\nvt 0 0\nvp 1 2\n"
        "usemtl wood\ns off\ng group v f\nf 1 2 3\nl 1 2 3\np 1\no second\nfo 1 2 3\nf 1 2\ncomment f 1 2 3\nf 1 3 4\n"
    )
    assert faces_of(text) == [[0, 1, 2], [0, 2, 3]]


def test_obj_vertices_with_colours_and_weights():
    read = read_mesh(b"v 0 0 0 0.5 0.5 0.5\nv 1 0 0 1.0\nv 0 1 0\nf 1 2 3\n", "a.obj")
    assert read.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


NUMBERS = [
    "0", "-0", "1", "-1.5", "+2.25", ".5", "5.", "1e3", "1E+3", "-2.5e-3", "1.7976931348623157e308", "1e-300",
    "0.1", "123456789012345", "0.000000123456789", "1234567.891", "3.141592653589793", "0.30000000000000004",
    "12345678901234567890123", "0.1234567890123456789", "1e22", "1e23", "2.2250738585072014e-308", "1d2",
]  # fmt: skip


def test_numbers_are_exact_to_15_digits_and_within_two_units_beyond():
    from model.formats._text import as_bytes, parse_numbers

    values = parse_numbers(as_bytes(" ".join(NUMBERS).encode()))[0]
    assert len(values) == len(NUMBERS)
    for text, value in zip(NUMBERS, values, strict=True):
        exact = float(text.replace("d", "e"))
        digits = len(text.lower().split("e")[0].strip("+-").replace(".", "").lstrip("0"))
        if digits <= 15 and 1e-22 < abs(exact) < 1e22:
            assert value == exact, text
        assert abs(value - exact) <= 2 * np.spacing(abs(exact)), text


def test_random_numbers_survive_a_round_trip_through_text():
    from model.formats._text import as_bytes, parse_numbers

    rng = np.random.default_rng(31)
    exact = rng.normal(size=20_000) * 10.0 ** rng.integers(-12, 12, 20_000)
    values = parse_numbers(as_bytes("\n".join(map(repr, exact.tolist())).encode()))[0]
    assert np.abs((values - exact) / np.spacing(np.abs(exact))).max() <= 2
    # Opposite numbers stay opposite: no symmetry is lost in reading.
    assert np.array_equal(parse_numbers(as_bytes("\n".join(map(repr, (-exact).tolist())).encode()))[0], -values)


# --- STL ---------------------------------------------------------------------------------------------------------------


def test_binary_stl_whose_header_says_solid():
    data = sample().export(file_type="stl")
    read = read_mesh(b"solid facet normal".ljust(80) + data[80:], "a.stl")
    assert len(read.faces) == len(sample().faces)


def test_ascii_stl_with_odd_case_and_spacing():
    facet = "FACET NORMAL 0 0 1\nouter  loop\n Vertex 0 0 0\r\n\tvertex 1.0e0 0 0\n  vertex 0 1 0\nendloop endfacet\n"
    read = read_mesh(("  Solid vertex\n" + facet + facet.replace("1 0\n", "1 2\n") + "endsolid").encode(), "a.stl")
    assert read.faces.tolist() == [[0, 1, 2], [3, 4, 5]]
    assert read.vertices[5].tolist() == [0, 1, 2]


# --- OFF ---------------------------------------------------------------------------------------------------------------

POSITIONS = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n"


@pytest.mark.parametrize(
    "text",
    [
        f"OFF\n4 2 0\n{POSITIONS}3 0 1 2\n3 0 1 3\n",
        f"OFF4 2 0\n{POSITIONS}3 0 1 2\n3 0 1 3\n",  # as found in ModelNet
        f"OFF 4 2\n{POSITIONS}3 0 1 2\n3 0 1 3",
        f"# first\nOFF # the format\n\n# counts\n4 2 0 # no edges\n{POSITIONS}3 0 1 2 # a face\n3 0 1 3\n",
        f"OFF\n4 2 0\n{POSITIONS}3 0 1 2 255 0 0\n3 0 1 3 0.5 0.5 0.5 1\n",
        "COFF\n4 2 0\n0 0 0 255 0 0 255\n1 0 0 1 1 1 1\n0 1 0 0 0 0 0\n0 0 1 9 9 9 9\n3 0 1 2\n3 0 1 3\n",
        "OFF 4 2 0 0 0 0 1 0 0 0 1 0 0 0 1 3 0 1 2 3 0 1 3",
        "NOFF\r\n4 2 0\r\n0 0 0 0 0 1\r\n1 0 0 0 0 1\r\n0 1 0 0 0 1\r\n0 0 1 0 0 1\r\n3 0 1 2\r\n3 0 1 3\r\n",
    ],
)
def test_off_in_all_spellings(text):
    read = read_mesh(text.encode(), "a.off")
    assert read.faces.tolist() == [[0, 1, 2], [0, 1, 3]]
    assert read.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]


def test_off_polygons_become_fans():
    read = read_mesh(b"OFF\n5 1 0\n0 0 0\n1 0 0\n1 1 0\n.5 2 0\n0 1 0\n5 0 1 2 3 4\n", "a.off")
    assert read.faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4]]


# --- PLY ---------------------------------------------------------------------------------------------------------------


def ply(order, vertex_properties, rows, faces, extra=""):
    """A file with quads and triangles; `rows` are packed vertices."""
    header = (
        f"ply\nformat {order} 1.0\ncomment end_header is further down\n{extra}"
        f"element vertex {len(rows)}\n{vertex_properties}"
        f"element face {len(faces)}\nproperty uchar flag\nproperty list uchar int vertex_index\n"
        f"property list uchar float texcoord\nend_header\n"
    )
    mark = ">" if "big" in order else "<"
    body = b"".join(rows)
    for face in faces:
        body += struct.pack(f"{mark}BB{len(face)}iB2f", 7, len(face), *face, 2, 0.5, 0.5)
    return header.replace("comment end_header is further down\n", "comment nothing\n").encode() + body


@pytest.mark.parametrize("order", ["binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("faces", [[[0, 1, 2], [0, 2, 3]], [[0, 1, 2, 3]], [[0, 1, 2], [0, 1, 2, 3]]])
def test_ply_binary_layouts(order, faces):
    mark = ">" if "big" in order else "<"
    square = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    rows = [struct.pack(f"{mark}BdfhI", 255, x, y, z, 9) for x, y, z in square]
    properties = "property uchar red\nproperty double x\nproperty float y\nproperty short z\nproperty uint id\n"
    read = read_mesh(ply(order, properties, rows, faces), "a.ply")
    assert read.vertices.tolist() == [list(map(float, point)) for point in square]
    expected = [[face[0], face[i], face[i + 1]] for face in faces for i in range(1, len(face) - 1)]
    assert read.faces.tolist() == expected


def test_ply_lists_among_the_vertices_and_unknown_elements():
    extra = "element camera 2\nproperty list uchar short view\nproperty float f\n"
    properties = "property list uint8 int32 neighbours\nproperty float32 x\nproperty float32 y\nproperty float32 z\n"
    rows = [struct.pack(f"<B{n}i3f", n, *range(n), *point) for n, point in enumerate(np.eye(3).tolist())]
    data = ply("binary_little_endian", properties, rows, [[0, 1, 2]], extra)
    body = data.index(b"end_header\n") + 11
    cameras = struct.pack("<B3hf", 3, 1, 2, 3, 0.5) + struct.pack("<Bf", 0, 0.5)
    read = read_mesh(data[:body] + cameras + data[body:], "a.ply")
    assert read.vertices.tolist() == np.eye(3).tolist()


def test_ply_ascii_with_everything_unusual():
    text = (
        "ply\r\nformat ascii 1.0\r\nobj_info from nowhere\r\nelement note 1\r\nproperty list int float values\r\n"
        "element vertex 4\r\nproperty float nx\r\nproperty float z\r\nproperty float y\r\nproperty float x\r\n"
        "element face 2\r\nproperty list uchar int vertex_indices\r\nproperty int group\r\nend_header\r\n"
        "2 0.5 0.5\r\n9 0 0 0\r\n9 0 0 1\r\n9 0 1 1\r\n9 0 1 0\r\n4 0 1 2 3 7\r\n3 0 1 2 7\r\n"
    )
    read = read_mesh(text.encode(), "a.ply")
    assert read.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    assert read.faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 2]]


def test_ply_triangle_strips():
    header = (
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
        "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    )
    read = read_mesh(f"{header}0 0 0\n1 0 0\n0 1 0\n1 1 0\n8 0 1 2 3 -1 3 2 1\n".encode(), "a.ply")
    assert read.faces.tolist() == [[0, 1, 2], [2, 1, 3], [3, 2, 1]]


# --- glTF --------------------------------------------------------------------------------------------------------------

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], dtype="<f4")


def gltf(buffer, accessors, views, primitives, nodes=None, **more):
    document = {
        "asset": {"version": "2.0"},
        "buffers": [
            {"byteLength": len(buffer), "uri": "data:;base64," + base64.b64encode(buffer).decode()},
        ],
        "bufferViews": [{"buffer": 0, **view} for view in views],
        "accessors": accessors,
        "meshes": [{"primitives": primitives}],
        "nodes": nodes or [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
        **more,
    }
    return json.dumps(document).encode()


def corners_gltf(primitive, indices=(), **more):
    data = CORNERS.tobytes() + np.array(indices, dtype="<u2").tobytes()
    return gltf(
        data,
        [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": len(indices), "type": "SCALAR"},
        ],
        [{"byteLength": 48}, {"byteOffset": 48, "byteLength": 2 * len(indices)}],
        [{"attributes": {"POSITION": 0}, **primitive}],
        **more,
    )


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


@pytest.mark.parametrize("name", ["KHR_draco_mesh_compression", "EXT_meshopt_compression", "EXT_mesh_gpu_instancing"])
def test_gltf_extensions_that_hide_geometry_are_named(name):
    data = corners_gltf({"indices": 1}, [0, 1, 2], extensionsUsed=[name])
    with pytest.raises(UnsupportedFormatError, match="not supported"):
        read_mesh(data, "a.gltf")


# --- 3MF ---------------------------------------------------------------------------------------------------------------

XML_TETRAHEDRON = (
    "<vertices><vertex x='0' y='0' z='0'/><vertex x='1' y='0' z='0'/><vertex x='0' y='1' z='0'/>"
    "<vertex x='0' y='0' z='1'/></vertices><triangles><triangle v1='0' v2='2' v3='1'/>"
    "<triangle v1='0' v2='1' v3='3'/><triangle v1='0' v2='3' v3='2'/><triangle v1='1' v2='2' v3='3'/></triangles>"
)
BUILD = "<build><item objectid='1'/></build>"


def archive(model, **parts):
    stream = BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("3D/3dmodel.model", model)
        for name, content in parts.items():
            file.writestr(name, content)
    return stream.getvalue()


def three_mf(objects, build, **parts):
    core = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
    production = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
    return archive(
        f"<?xml version='1.0'?><model xmlns='{core}' xmlns:p='{production}'><resources>{objects}</resources>"
        f"<build>{build}</build></model>",
        **parts,
    )


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
