"""glTF whose attributes are compressed with Draco: not the positions alone."""

import json

import DracoPy
import numpy as np
import pytest

from model.errors import UnreadableMeshError
from model.formats import read_mesh
from tests.model.mesh_files import gltf

F32, U8, U16 = 5126, 5121, 5123
SQUARE = np.array([[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0]], "<f4")
FACES = np.array([[0, 1, 2], [0, 2, 3]], "<u4")
JOINTS = np.array([[0, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0]], "u1")
WEIGHTS = np.array([[1, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0], [0.5, 0.5, 0, 0]], "f4")


def compressed(attributes, nodes, colors=None, **more):
    """A square; the numbers of attributes besides the positions are theirs in the Draco data."""
    generic = {number: values for number, _, values in attributes.values()}
    data = DracoPy.encode(SQUARE, FACES, quantization_bits=16, colors=colors, generic_attributes=generic)
    numbers = {each["attribute_type"]: each["unique_id"] for each in DracoPy.decode(data).attributes}
    bind = np.tile(np.eye(4, dtype="<f4"), (2, 1, 1)).tobytes()
    accessors = [
        {"componentType": F32, "count": 4, "type": "VEC3"},
        {"componentType": U16, "count": 6, "type": "SCALAR"},
        {"bufferView": 1, "componentType": F32, "count": 2, "type": "MAT4"},
    ]
    stored, draco = {"POSITION": 0}, {"POSITION": numbers[0]}
    for name, (number, kind, _) in attributes.items():
        stored[name], draco[name] = len(accessors), number
        accessors.append({"componentType": kind, "count": 4, "type": "VEC4"})
    if colors is not None:
        stored["COLOR_0"], draco["COLOR_0"] = len(accessors), numbers[2]
        accessors.append({"componentType": U8, "normalized": True, "count": 4, "type": "VEC4"})
    filled = data + b"\0" * (-len(data) % 4)
    views = [{"byteLength": len(data)}, {"byteOffset": len(filled), "byteLength": len(bind)}]
    extension = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": draco}}
    primitive = {"attributes": stored, "indices": 1, "extensions": extension}
    return gltf(filled + bind, accessors, views, [primitive], nodes=nodes, scenes=[{"nodes": [0]}], **more)


def skinned():
    nodes = [{"mesh": 0, "skin": 0, "children": [1, 2]}, {}, {"translation": [0, 0, 6]}]
    attributes = {"JOINTS_0": (7, U8, JOINTS), "WEIGHTS_0": (9, F32, WEIGHTS)}
    return compressed(attributes, nodes, skins=[{"joints": [1, 2], "inverseBindMatrices": 2}])


def test_a_skin_in_draco_is_read_at_its_pose():
    mesh = read_mesh(skinned(), "a.gltf")
    corners = np.unique(mesh.vertices[mesh.faces].reshape(-1, 3).round(3), axis=0)
    assert corners == pytest.approx(np.array([[0, 0, 0], [0, 4, 3], [4, 0, 6], [4, 4, 6]]), abs=2e-3)


def test_draco_without_an_attribute_that_is_announced_is_an_error():
    document = json.loads(skinned())
    document["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"]["attributes"]["JOINTS_0"] = 77
    with pytest.raises(UnreadableMeshError, match="Draco"):
        read_mesh(json.dumps(document).encode(), "a.gltf")


def test_colours_in_draco_are_read():
    colors = np.array([[255, 0, 0, 255], [0, 255, 0, 255], [0, 0, 255, 255], [255, 255, 255, 128]], "u1")
    mesh = read_mesh(compressed({}, [{"mesh": 0}], colors), "a.gltf")
    seen = {
        tuple(np.rint(point).astype(int)): tuple(color) for point, color in zip(mesh.vertices, mesh.colors, strict=True)
    }
    expected = {tuple(point.astype(int)): tuple(color) for point, color in zip(SQUARE, colors, strict=True)}
    assert seen == expected
