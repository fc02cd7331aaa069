"""Files in memory for the reader tests: exports of one mesh, and builders of odd ones."""

import base64
import json
import struct
import zipfile
from io import BytesIO

import numpy as np
import trimesh

SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"


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
    data = mesh.export(file_type="ply", encoding="ascii") if kind == "ply_ascii" else mesh.export(file_type=kind)
    return data.encode() if isinstance(data, str) else data


KINDS = ["stl", "stl_ascii", "obj", "ply", "ply_ascii", "off", "glb", "gltf", "3mf"]


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
