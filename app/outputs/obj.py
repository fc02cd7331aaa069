"""OBJ text: all digits of the coordinates, shared vertices."""

import numpy as np

from app.outputs.mesh_file import Counts, MeshWriter, require
from app.outputs.output_format import OutputFormat
from model.meshes.texture import Texture
from model.types import ByteArray, FloatArray, IntArray

_ALPHABET = b"vf 0123456789.e+-\n"
_HEAD = b"# written by prsnet\n"


def _body(
    vertices: FloatArray,
    faces: IntArray,
    bounds: list[list[float]],
    colors: ByteArray | None = None,
    texture: Texture | None = None,
) -> bytes:
    if colors is None:
        points = "v %r %r %r\n" * len(vertices) % tuple(vertices.ravel().tolist())
    else:  # behind the position, as many programs read and write them
        numbers = np.concatenate([vertices, np.round(colors[:, :3] / 255.0, 4)], axis=1)
        points = "v %r %r %r %r %r %r\n" * len(vertices) % tuple(numbers.ravel().tolist())
    corners = "f %d %d %d\n" * len(faces) % tuple((faces.ravel() + 1).tolist())
    return (points + corners).encode()


def _head(counts: Counts, body: bytes) -> bytes:
    # No letter but these: no name of a material, of a file, no number that is none.
    require(not body.translate(None, _ALPHABET), "a character that is in no coordinate")
    lines = body.count(b"\nv ") + body.startswith(b"v "), body.count(b"\nf ")
    require(lines == (counts.vertices, counts.faces), "another number of lines")
    return _HEAD


def _size(vertices: int, faces: int) -> int:
    return 78 * vertices + 36 * faces  # at most: three numbers of 24 characters, three of 10


WRITER = MeshWriter(_body, _head, _size, varies=True)
FORMAT = OutputFormat(
    "obj",
    "model/obj",
    "OBJ text: all digits of the coordinates, shared vertices.",
    mesh=WRITER,
)
