"""glTF 2.0: the containers. GLB, and JSON with buffers embedded or in files that the caller has at hand."""

import json
from dataclasses import replace
from typing import Any, cast

import numpy as np

from model.errors import UnreadableMeshError, UnsupportedFormatError
from model.formats._common import Limits, RawMesh, Reader, Resources, is_mirror, no_resources
from model.formats._gltf_bodies import Bodies
from model.formats._gltf_buffers import Buffers
from model.formats._gltf_scene import Scene
from model.meshes.colors import from_linear
from model.meshes.texture import lost_pictures, texture
from model.types import ByteArray, FloatArray

_MAGIC = b"glTF"
# What a file may require: read here, or without influence on where the surface is.
_KNOWN = frozenset(
    {
        "KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression", "EXT_mesh_gpu_instancing",
        "KHR_mesh_quantization", "KHR_node_visibility", "KHR_texture_transform", "KHR_texture_basisu",
        "KHR_lights_punctual", "KHR_animation_pointer", "KHR_xmp", "KHR_xmp_json_ld",
        "KHR_techniques_webgl", "KHR_technique_webgl",
        "KHR_node_hoverability", "KHR_node_selectability", "EXT_texture_webp", "EXT_texture_avif",
        "EXT_lights_image_based", "EXT_mesh_features", "EXT_instance_features", "EXT_structural_metadata",
        "EXT_mesh_manifold", "MSFT_texture_dds", "MSFT_packing_normalRoughnessMetallic",
        "MSFT_packing_occlusionRoughnessMetallic", "FB_geometry_metadata",
    }
)  # fmt: skip


def is_glb(data: bytes) -> bool:
    """Whether it begins with the signature of binary glTF."""
    return data.startswith(_MAGIC)


def is_gltf(data: bytes) -> bool:
    """Whether it begins like a JSON object."""
    head = data[:1024]
    return head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{") and b"\0" not in head


def read_glb(data: bytes, limits: Limits, resources: Resources = no_resources) -> RawMesh:
    """The binary container: a header and chunks."""
    if data[:4] != _MAGIC or len(data) < 20:
        raise UnreadableMeshError("The GLB file has no complete header.")
    version, length = np.frombuffer(data, "<u4", 2, 4).tolist()
    if version != 2:
        raise UnsupportedFormatError(_VERSION)
    if length > len(data):
        raise UnreadableMeshError("The GLB file is shorter than its header says.")
    document, binary = None, None
    at = 12
    while at + 8 <= length:
        size = int.from_bytes(data[at : at + 4], "little")
        kind = data[at + 4 : at + 8]
        if at + 8 + size > length:
            raise UnreadableMeshError("The GLB file is shorter than its chunks say.")
        if kind == b"JSON" and document is None:
            document = data[at + 8 : at + 8 + size]
        elif kind == b"BIN\0" and binary is None:
            binary = data[at + 8 : at + 8 + size]
        at += 8 + size
    if document is None:
        raise UnreadableMeshError("The GLB file has no JSON chunk.")
    return _read(document, binary, limits, resources)


def read_gltf(data: bytes, limits: Limits, resources: Resources = no_resources) -> RawMesh:
    """JSON, with buffers as base64 or among the resources."""
    return _read(data, None, limits, resources)


_VERSION = "Only version 2 of glTF is supported; open the file in Blender and export it as GLB."


def _read(text: bytes, binary: bytes | None, limits: Limits, resources: Resources) -> RawMesh:
    """All instances of the default scene in world coordinates, as a viewer shows them before it plays anything."""
    try:
        parsed: Any = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise UnreadableMeshError("The glTF file is not valid JSON.") from error
    if not isinstance(parsed, dict):
        raise UnreadableMeshError("The glTF file is not a JSON object.")
    document: Any = cast(Any, parsed)
    if "asset" not in document:
        raise UnreadableMeshError(
            "The file breaks the rules of glTF: its JSON has no asset. It is perhaps a message of the server that it "
            "came from; open it in a text editor."
        )
    try:
        if str(document["asset"]["version"])[:2] != "2.":
            raise UnsupportedFormatError(_VERSION)
        required: list[str] = document.get("extensionsRequired", [])
        if any(name not in _KNOWN and not name.startswith("KHR_materials_") for name in required):
            raise UnsupportedFormatError(
                "The glTF file requires an extension that is not known here, so its shape cannot be told; "
                "export it without extensions."
            )
        buffers = Buffers(document, binary, resources)
        scene = Scene(document, buffers, limits)
        bodies = Bodies(document, buffers, limits)
        raw = _flatten(scene, bodies, limits)
        # The format fixes the unit.
        warnings = (*scene.warnings, *bodies.warnings, *lost_pictures(bodies.looks.lost))
        return replace(raw, units="meter", warnings=warnings, painted=bodies.looks.painted)
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise UnreadableMeshError("The glTF file breaks the rules of its format.") from error


def _flatten(scene: Scene, bodies: Bodies, limits: Limits) -> RawMesh:
    """Vertices, faces and looks of all instances; the size of the result is checked before it exists."""
    vertices, faces = 0, 0
    shown = [(bodies.get(placed.mesh, placed.weights), placed) for placed in scene.placed]
    for body, placed in shown:
        copies = 1 if placed.skin is not None else len(placed.matrices)
        vertices += copies * len(body.vertices)
        faces += copies * len(body.faces)
        limits.check(vertices, faces)
    if max(vertices, faces) > 2**31 - 1:
        raise UnreadableMeshError("The glTF scene has more vertices than an index can express.")
    all_vertices = np.empty((vertices, 3))
    all_faces = np.empty((faces, 3), dtype=np.int32)
    colors: ByteArray | None = None
    if any(body.light is not None for body, _ in shown):
        colors = np.full((vertices, 4), 255, dtype=np.uint8)
    places, pictures = np.empty((0, 2)), np.empty(0, dtype=np.int32)
    if any(body.pictures is not None for body, _ in shown):
        places, pictures = np.zeros((vertices, 2)), np.full(faces, -1, dtype=np.int32)
    vertex, face = 0, 0
    for body, placed in shown:
        count = len(body.vertices)
        skin = None if placed.skin is None or body.joints is None else scene.joint_matrices(placed.skin)
        for matrix in placed.matrices[: 1 if placed.skin is not None else None]:
            part = all_vertices[vertex : vertex + count]
            with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is found by the checks of `Mesh`
                if skin is None:
                    _place(body.vertices, matrix, part)
                else:
                    part[:] = body.posed(skin)
            # A node that mirrors its mesh turns the triangles inside out, which viewers undo.
            corners = body.faces[:, ::-1] if skin is None and is_mirror(matrix[:3, :3]) else body.faces
            np.add(corners, vertex, out=all_faces[face : face + len(corners)], dtype=np.int32)
            if colors is not None and body.light is not None:
                colors[vertex : vertex + count] = from_linear(body.light)
            if body.pictures is not None:
                places[vertex : vertex + count] = body.places
                pictures[face : face + len(body.faces)] = body.pictures
            vertex += count
            face += len(body.faces)
    return RawMesh(all_vertices, all_faces, colors=colors, texture=texture(places, pictures, bodies.looks.pictures))


def _place(vertices: FloatArray, matrix: FloatArray, out: FloatArray) -> None:
    """Vertices ``(v, 3)`` in the world, by a ``(4, 4)`` matrix; sums are taken in one order on every machine."""
    if np.array_equal(matrix, np.eye(4)):
        out[:] = vertices
        return
    np.multiply(vertices[:, :1], matrix[:3, 0], out=out)
    for column in (1, 2):
        out += vertices[:, column : column + 1] * matrix[:3, column]
    out += matrix[:3, 3]


READERS = {"glb": Reader(read_glb, is_glb), "gltf": Reader(read_gltf, is_gltf)}
