"""Binary STL: 32-bit coordinates, every triangle on its own."""

import numpy as np

from app.outputs.mesh_file import Counts, MeshWriter, require, require_numbers
from app.outputs.output_format import OutputFormat
from model.errors import DegenerateMeshError
from model.meshes.texture import Texture
from model.types import ByteArray, FloatArray, IntArray

_TRIANGLE = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attributes", "<u2")])
_TITLE = b"binary STL written by prsnet"


def _body(
    vertices: FloatArray,
    faces: IntArray,
    bounds: list[list[float]],
    colors: ByteArray | None = None,
    texture: Texture | None = None,
) -> bytes:
    largest = float(np.finfo(np.float32).max) / 4.0
    if max(abs(value) for corner in bounds for value in corner) > largest:
        raise DegenerateMeshError("The coordinates are beyond the range of STL; another format can hold them.")
    corners = vertices[faces]
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        records = np.zeros(len(faces), dtype=_TRIANGLE)
        records["normal"] = np.where(np.isfinite(normals), normals, 0.0)
        records["corners"] = corners
    return records.tobytes()


def _head(counts: Counts, body: bytes) -> bytes:
    require(len(body) == _size(counts.vertices, counts.faces), "a body of another size")
    records = np.frombuffer(body, _TRIANGLE)
    require_numbers(records["normal"])
    require_numbers(records["corners"])
    return _TITLE.ljust(80) + counts.faces.to_bytes(4, "little")


def _size(vertices: int, faces: int) -> int:
    return _TRIANGLE.itemsize * faces


WRITER = MeshWriter(_body, _head, _size)
FORMAT = OutputFormat(
    "stl",
    "model/stl",
    "Binary STL: 32-bit coordinates, every triangle on its own.",
    mesh=WRITER,
)
