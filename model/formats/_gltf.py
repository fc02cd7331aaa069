"""glTF 2.0: GLB and JSON with embedded buffers. Node transforms are applied; external files are never opened."""

import base64
import binascii
import json
from dataclasses import dataclass
from typing import Any
from urllib.parse import unquote_to_bytes

import numpy as np

from model.errors import UnreadableMeshError, UnsupportedFormatError
from model.formats._accessors import read_accessor
from model.formats._common import Limits, RawMesh, Reader, as_indices, no_faces, strip
from model.types import AnyArray, FloatArray, IntArray

_MAGIC = b"glTF"
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
# Extensions that change where the surface is, or how its numbers are stored.
_REFUSED = {
    "KHR_draco_mesh_compression": "Draco compression",
    "EXT_meshopt_compression": "meshopt compression",
    "KHR_meshopt_compression": "meshopt compression",
    "EXT_mesh_gpu_instancing": "GPU instancing",
}


@dataclass(frozen=True, slots=True)
class _Body:
    """One mesh of the file in its own coordinates."""

    vertices: FloatArray
    faces: IntArray


@dataclass(frozen=True, slots=True)
class _Instance:
    """A mesh placed in the world."""

    mesh: int
    matrix: FloatArray  # (4, 4), column vectors


def is_glb(data: bytes) -> bool:
    """Whether it begins with the signature of binary glTF."""
    return data.startswith(b"glTF")


def is_gltf(data: bytes) -> bool:
    """Whether it begins like a JSON object."""
    head = data[:1024]
    return head.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"{") and b"\0" not in head


def read_glb(data: bytes, limits: Limits) -> RawMesh:
    """The binary container: a header and chunks."""
    if data[:4] != _MAGIC or len(data) < 20:
        raise UnreadableMeshError("The GLB file has no complete header.")
    version, length = np.frombuffer(data, "<u4", 2, 4).tolist()
    if version != 2:
        raise UnsupportedFormatError("Only version 2 of glTF is supported.")
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
    return _Reader(document, binary, limits).read()


def read_gltf(data: bytes, limits: Limits) -> RawMesh:
    """JSON with all buffers embedded as base64."""
    return _Reader(data, None, limits).read()


class _Reader:
    """Reads one document."""

    def __init__(self, document: bytes, binary: bytes | None, limits: Limits) -> None:
        try:
            self._json: Any = json.loads(document)
        except (ValueError, RecursionError) as error:
            raise UnreadableMeshError("The glTF file is not valid JSON.") from error
        if not isinstance(self._json, dict):
            raise UnreadableMeshError("The glTF file is not a JSON object.")
        self._binary = binary
        self._limits = limits
        self._buffers: dict[int, bytes] = {}

    def read(self) -> RawMesh:
        """All instances of the scene in world coordinates."""
        try:
            if str(self._json["asset"]["version"])[:2] != "2.":
                raise UnsupportedFormatError("Only version 2 of glTF is supported.")
            used = {*self._json.get("extensionsUsed", ()), *self._json.get("extensionsRequired", ())}
            for name, words in _REFUSED.items():
                if name in used:
                    raise UnsupportedFormatError(f"glTF files with {words} are not supported.")
            return self._flatten(self._instances())
        except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise UnreadableMeshError("The glTF file breaks the rules of its format.") from error

    def _instances(self) -> list[_Instance]:
        """The meshes of the default scene with their world transforms; every node may be reached once only."""
        nodes = self._json.get("nodes", [])
        scenes = self._json.get("scenes", [])
        if scenes:
            roots = scenes[self._json.get("scene", 0)].get("nodes", [])
        else:
            children = {child for node in nodes for child in node.get("children", [])}
            roots = [index for index in range(len(nodes)) if index not in children]
        found: list[_Instance] = []
        visited: set[int] = set()
        waiting: list[tuple[int, FloatArray]] = [(root, np.eye(4)) for root in reversed(roots)]
        while waiting:
            index, parent = waiting.pop()
            if index in visited or index < 0:
                raise UnreadableMeshError("The glTF file has a node with more than one parent.")
            visited.add(index)
            self._limits.check(nodes=len(visited))
            node = nodes[index]
            matrix = parent @ _local_matrix(node)
            if "mesh" in node:
                found.append(_Instance(int(node["mesh"]), matrix))
            waiting += [(child, matrix) for child in reversed(node.get("children", []))]
        return found

    def _flatten(self, instances: list[_Instance]) -> RawMesh:
        """Apply the transforms; the size of the result is checked before it exists."""
        meshes = self._json.get("meshes", [])
        bodies: dict[int, _Body] = {}
        vertices, faces = 0, 0
        for instance in instances:
            if instance.mesh < 0:
                raise UnreadableMeshError("The glTF file has a negative index.")
            if instance.mesh not in bodies:
                bodies[instance.mesh] = self._body(meshes[instance.mesh])
            vertices += len(bodies[instance.mesh].vertices)
            faces += len(bodies[instance.mesh].faces)
            self._limits.check(vertices, faces)
        if max(vertices, faces) > 2**31 - 1:
            raise UnreadableMeshError("The glTF scene has more vertices than an index can express.")
        all_vertices = np.empty((vertices, 3))
        all_faces = np.empty((faces, 3), dtype=np.int32)
        vertex, face = 0, 0
        for instance in instances:
            body = bodies[instance.mesh]
            placed = all_vertices[vertex : vertex + len(body.vertices)]
            np.matmul(body.vertices, instance.matrix[:3, :3].T, out=placed)
            placed += instance.matrix[:3, 3]
            if body.faces.size and (body.faces.min() < 0 or body.faces.max() >= len(body.vertices)):
                raise UnreadableMeshError("The glTF file has a face that refers to a vertex that does not exist.")
            all_faces[face : face + len(body.faces)] = body.faces + vertex
            vertex += len(body.vertices)
            face += len(body.faces)
        return RawMesh(all_vertices, all_faces, "meter")  # the format fixes the unit

    def _body(self, mesh: Any) -> _Body:
        """The triangles of a mesh; primitives that share their positions share the vertices."""
        vertices: list[FloatArray] = []
        faces: list[IntArray] = [no_faces()]
        starts: dict[int, tuple[int, int]] = {}
        total, made = 0, 0
        for primitive in mesh["primitives"]:
            mode = primitive.get("mode", _TRIANGLES)
            if mode not in (_TRIANGLES, _STRIP, _FAN) or "POSITION" not in primitive["attributes"]:
                continue
            position = primitive["attributes"]["POSITION"]
            if position not in starts:
                self._limits.check(vertices=total + self._count(position))
                points = self._accessor(position, 3).astype(np.float64)
                starts[position] = total, len(points)
                vertices.append(points)
                total += len(points)
            start, count = starts[position]
            if "indices" in primitive:
                self._check_faces(primitive["indices"], mode, made)
                indices = as_indices(self._accessor(primitive["indices"], 1).reshape(-1))
            else:
                indices = np.arange(count, dtype=np.int32)
            faces.append(_triangles(indices, mode) + np.int32(start))
            made += len(faces[-1])
            self._limits.check(faces=made)
        return _Body(np.concatenate(vertices) if vertices else np.empty((0, 3)), np.concatenate(faces))

    def _count(self, index: int) -> int:
        return max(int(self._json["accessors"][index]["count"]), 0)

    def _check_faces(self, index: int, mode: int, made: int) -> None:
        """Primitives may share indices: a few bytes of JSON can ask for as many triangles as there are bytes."""
        count = self._count(index)
        self._limits.check(faces=made + (count // 3 if mode == _TRIANGLES else max(count - 2, 0)))

    def _accessor(self, index: int, width: int) -> AnyArray:
        if index < 0:
            raise UnreadableMeshError("The glTF file has a negative index.")
        return read_accessor(self._json, index, width, self._view)

    def _view(self, index: int) -> tuple[bytes, int, int, int]:
        """Buffer, first byte, end, and stride (0 if packed) of a buffer view."""
        view = self._json["bufferViews"][index]
        buffer = self._buffer(view["buffer"])
        start = int(view.get("byteOffset", 0))
        end = start + int(view["byteLength"])
        if start < 0 or end < start or end > len(buffer):
            raise UnreadableMeshError("The glTF file has a buffer view beyond its buffer.")
        return buffer, start, end, int(view.get("byteStride", 0))

    def _buffer(self, index: int) -> bytes:
        if index not in self._buffers:
            uri = self._json["buffers"][index].get("uri")
            if uri is None:
                if self._binary is None or index != 0:
                    raise UnreadableMeshError("The glTF file has a buffer without content.")
                self._buffers[index] = self._binary
            else:
                self._buffers[index] = _embedded(uri)
        return self._buffers[index]


def _embedded(uri: str) -> bytes:
    """Content of a data URI."""
    if not uri[:5].lower() == "data:":
        raise UnreadableMeshError(
            "The glTF file keeps its buffers in other files, which are not followed; export it as GLB instead."
        )
    head, _, body = uri.partition(",")
    if not head.lower().endswith(";base64"):
        return unquote_to_bytes(body)
    try:
        return base64.b64decode(body)
    except binascii.Error as error:
        raise UnreadableMeshError("The glTF file has an embedded buffer that is no base64.") from error


def _triangles(indices: IntArray, mode: int) -> IntArray:
    if mode == _TRIANGLES:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    if mode == _STRIP:
        return strip(indices)
    if len(indices) < 3:
        return no_faces()
    return np.stack([np.full(len(indices) - 2, indices[0], np.int32), indices[1:-1], indices[2:]], axis=1)


def _local_matrix(node: Any) -> FloatArray:
    """(4, 4) transform of a node, from its matrix or from translation, rotation and scale."""
    matrix = np.eye(4)
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    if "rotation" in node:
        x, y, z, w = np.array(node["rotation"], dtype=np.float64)
        length = x * x + y * y + z * z + w * w
        s = 2.0 / length if length > 0 else 0.0
        matrix[:3, :3] = [
            [1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
            [s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)],
            [s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)],
        ]
    if "scale" in node:
        matrix[:3, :3] *= np.array(node["scale"], dtype=np.float64).reshape(3)
    if "translation" in node:
        matrix[:3, 3] = np.array(node["translation"], dtype=np.float64).reshape(3)
    return matrix


READERS = {"glb": Reader(read_glb, is_glb), "gltf": Reader(read_gltf, is_gltf)}
