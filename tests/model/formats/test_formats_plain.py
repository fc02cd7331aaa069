"""Odd but legal files of the formats that hold one mesh: OBJ, STL, OFF, PLY."""

import struct

import numpy as np
import pytest

from model.formats import read_mesh
from tests.model.mesh_files import SQUARE, ply, sample

# --- OBJ ----------------------------------------------------------------------------------------------------


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


# --- STL ----------------------------------------------------------------------------------------------------


def test_binary_stl_whose_header_says_solid():
    data = sample().export(file_type="stl")
    read = read_mesh(b"solid facet normal".ljust(80) + data[80:], "a.stl")
    assert len(read.faces) == len(sample().faces)


def test_ascii_stl_with_odd_case_and_spacing():
    facet = "FACET NORMAL 0 0 1\nouter  loop\n Vertex 0 0 0\r\n\tvertex 1.0e0 0 0\n  vertex 0 1 0\nendloop endfacet\n"
    read = read_mesh(("  Solid vertex\n" + facet + facet.replace("1 0\n", "1 2\n") + "endsolid").encode(), "a.stl")
    assert read.faces.tolist() == [[0, 1, 2], [3, 4, 5]]
    assert read.vertices[5].tolist() == [0, 1, 2]


# --- OFF ----------------------------------------------------------------------------------------------------

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


# --- PLY ----------------------------------------------------------------------------------------------------


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
