"""Pictures in the body of a GLB: what a worker appends to its geometry, and the checks of it.

Behind positions, triangles and colours of all vertices stand the places of vertices in their picture, the pictures,
each filled up to four bytes, and a table: of each picture its kind, its bytes and how many triangles have it, then how
many pictures there are, how many triangles have none, and a mark. Triangles without a picture come first, then those of
each.
"""

import struct
from dataclasses import dataclass

import numpy as np

from app.outputs.mesh_file import require, require_numbers
from model.meshes.texture import MOST_PICTURES, SIGNATURE_BYTES, Texture, picture
from model.types import IntArray

_MARK = b"PICT"
_FOOT = struct.Struct("<II4s")
_ROW = struct.Struct("<III")
_KINDS = ("image/png", "image/jpeg", "image/webp", "image/ktx2")


@dataclass(frozen=True, slots=True)
class Laid:
    """One picture of a body: its kind, where its bytes are in the body, and how many triangles have it."""

    media_type: str
    start: int
    length: int
    faces: int


@dataclass(frozen=True, slots=True)
class Pictures:
    """Where the places (v, 2) are in the body, how many triangles have no picture, and the pictures."""

    places: int
    plain: int
    laid: list[Laid]


def face_order(texture: Texture) -> IntArray:
    """The order of a mesh's triangles in the body: (f,)."""
    return np.argsort(texture.of_face, kind="stable").astype(np.int32)


def appendix(texture: Texture) -> bytes:
    """What a body has behind its geometry and colours."""
    counts = np.bincount(texture.of_face + 1, minlength=len(texture.pictures) + 1).tolist()
    parts, rows = [texture.places.astype("<f4").tobytes()], list[bytes]()
    for each, faces in zip(texture.pictures, counts[1:], strict=True):
        parts.append(each.content + b"\0" * (-len(each.content) % 4))
        rows.append(_ROW.pack(_KINDS.index(each.media_type), len(each.content), faces))
    return b"".join([*parts, *rows, _FOOT.pack(len(texture.pictures), counts[0], _MARK)])


def read_appendix(body: bytes, start: int, vertices: int, faces: int) -> Pictures:
    """The pictures of a body whose geometry and colours end at ``start``.

    Raises:
        BodyError: they are none, or do not fit to the counts.
    """
    rest = len(body) - start
    require(rest >= 8 * vertices + _FOOT.size, "a body of another size")
    count, plain, mark = _FOOT.unpack_from(body, len(body) - _FOOT.size)
    require(mark == _MARK and 0 < count <= MOST_PICTURES, "a body of another size")
    table = len(body) - _FOOT.size - count * _ROW.size
    at = start + 8 * vertices
    require_numbers(np.frombuffer(body, "<f4", 2 * vertices, start))
    laid: list[Laid] = []
    for index in range(count):
        require(at <= table, "pictures of another size")
        row: tuple[int, int, int] = _ROW.unpack_from(body, table + index * _ROW.size)
        kind, length, own = row
        require(kind < len(_KINDS) and at + length <= table, "pictures of another size")
        found = picture(body[at : at + SIGNATURE_BYTES])
        require(found is not None and found.media_type == _KINDS[kind], "a picture that is none")
        laid.append(Laid(_KINDS[kind], at, length, own))
        at += length + -length % 4
    require(at == table, "pictures of another size")
    require(plain + sum(each.faces for each in laid) == faces, "pictures on another number of faces")
    return Pictures(start, plain, laid)
