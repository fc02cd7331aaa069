"""Binary PLY: all digits of the coordinates, shared vertices."""

import numpy as np

from app.outputs.mesh_file import Counts, MeshWriter, require, require_indices, require_numbers
from app.outputs.output_format import OutputFormat
from model.meshes.texture import Texture
from model.types import ByteArray, FloatArray, IntArray

_FACE = np.dtype([("corners", "u1"), ("indices", "<i4", 3)])
_VERTEX_BYTES = 24
_HEAD = """\
ply
format binary_little_endian 1.0
comment written by prsnet
element vertex {vertices}
property double x
property double y
property double z
{colors}element face {faces}
property list uchar int vertex_indices
end_header
"""


_COLORS = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue", "alpha"))
_VERTEX = np.dtype([("position", "<f8", 3), ("color", "u1", 4)])


def _body(
    vertices: FloatArray,
    faces: IntArray,
    bounds: list[list[float]],
    colors: ByteArray | None = None,
    texture: Texture | None = None,
) -> bytes:
    records = np.empty(len(faces), dtype=_FACE)
    records["corners"] = 3
    records["indices"] = faces
    if colors is None:
        return vertices.astype("<f8").tobytes() + records.tobytes()
    points = np.empty(len(vertices), dtype=_VERTEX)
    points["position"] = vertices
    points["color"] = colors
    return points.tobytes() + records.tobytes()


def _head(counts: Counts, body: bytes) -> bytes:
    size = _size(counts.vertices, counts.faces)
    colored = len(body) == size + 4 * counts.vertices
    require(colored or len(body) == size, "a body of another size")
    if colored:
        vertices = np.frombuffer(body, _VERTEX, counts.vertices)["position"]
    else:
        vertices = np.frombuffer(body, "<f8", 3 * counts.vertices)
    faces = np.frombuffer(body, _FACE, counts.faces, (_VERTEX_BYTES + 4 * colored) * counts.vertices)
    require_numbers(vertices)
    require(bool((faces["corners"] == 3).all()), "a face that is no triangle")
    require_indices(faces["indices"], counts.vertices)
    return _HEAD.format(vertices=counts.vertices, faces=counts.faces, colors=_COLORS if colored else "").encode()


def _size(vertices: int, faces: int) -> int:
    return _VERTEX_BYTES * vertices + _FACE.itemsize * faces


WRITER = MeshWriter(_body, _head, _size)
FORMAT = OutputFormat(
    "ply",
    "application/octet-stream",
    "Binary PLY: all digits of the coordinates, shared vertices.",
    mesh=WRITER,
)
