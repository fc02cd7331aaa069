"""STL, binary and ASCII, told apart by content: a binary file may start with the word "solid" too."""

import numpy as np

from model._jit import jit
from model.errors import UnreadableMeshError
from model.formats._common import Limits, RawMesh, Reader, alone
from model.formats._text import as_bytes, parse_number, unix_lines
from model.types import ByteArray, FloatArray

_HEADER = 84
_OTHER_FORMATS = (b"ply", b"glTF", b"PK\x03\x04")
_RECORD = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (9,)), ("attribute", "<u2")])


def read_stl(data: bytes, limits: Limits) -> RawMesh:
    """Three vertices a triangle, in file order; the stored normals are not read."""
    if is_binary_stl(data):
        count = int.from_bytes(data[80:84], "little")
        limits.check(3 * count, count)
        records = np.frombuffer(data, _RECORD, count, _HEADER)
        vertices = records["corners"].astype(np.float64).reshape(-1, 3)
    elif is_ascii_stl(data):
        raw = as_bytes(unix_lines(data))
        count = _count_vertices(raw)
        limits.check(count, count // 3)
        vertices = np.empty((count, 3))
        if not _read_vertices(raw, vertices):
            raise UnreadableMeshError("The STL file has a vertex without three numbers.")
        if count % 3:
            raise UnreadableMeshError("The STL file ends inside a triangle.")
    else:
        raise UnreadableMeshError("The STL file is shorter than its header says.")
    return RawMesh(vertices, np.arange(len(vertices), dtype=np.int32).reshape(-1, 3))


def is_stl(data: bytes) -> bool:
    """Whether it is binary, or text that goes on like an STL file."""
    # The header of a binary file is free text, which may look like anything; a length that fits by chance does not
    # outweigh the signature of another format.
    return (is_binary_stl(data) and not data.startswith(_OTHER_FORMATS)) or is_ascii_stl(data)


def is_binary_stl(data: bytes) -> bool:
    """Whether the triangle count fits the length; more bytes than needed are tolerated unless it looks like text."""
    if len(data) < _HEADER:
        return False
    needed = _HEADER + _RECORD.itemsize * int.from_bytes(data[80:84], "little")
    return len(data) == needed or (len(data) > needed > _HEADER and not is_ascii_stl(data))


def is_ascii_stl(data: bytes) -> bool:
    """Whether the text begins with "solid" and goes on like an STL file."""
    start = data[:1024].lstrip(b"\xef\xbb\xbf \t\r\n").lower()
    if not start.startswith(b"solid") or b"\0" in data[:1024]:
        return False
    return b"facet" in start or b"endsolid" in data.lower() or b"facet" in data.lower()


@jit
def _word(data: ByteArray, at: int, end: int) -> int:
    """1 for the word "vertex", 2 for "solid" and "endsolid", 0 for any other that starts here."""
    length = 0
    while at + length < end and length < 9 and data[at + length] > 32:
        length += 1
    if length == 6 and data[at] | 32 == 118 and data[at + 1] | 32 == 101 and data[at + 2] | 32 == 114:
        return int(data[at + 3] | 32 == 116 and data[at + 4] | 32 == 101 and data[at + 5] | 32 == 120)
    if length == 8 and data[at] | 32 == 101 and data[at + 1] | 32 == 110 and data[at + 2] | 32 == 100:
        at += 3
        length = 5
    solid = length == 5 and data[at] | 32 == 115 and data[at + 1] | 32 == 111 and data[at + 2] | 32 == 108
    return 2 if solid and data[at + 3] | 32 == 105 and data[at + 4] | 32 == 100 else 0


@jit
def _next_vertex(data: ByteArray, at: int) -> int:
    """The place after the next word "vertex", or -1; the line of a solid holds its name, which may be any word."""
    end = data.shape[0]
    while at < end:
        if data[at] <= 32:
            at += 1
            continue
        word = _word(data, at, end)
        if word == 1:
            return at + 6
        if word == 2:
            while at < end and data[at] != 10:
                at += 1
        while at < end and data[at] > 32:
            at += 1
    return -1


@jit
def _count_vertices(data: ByteArray) -> int:
    count, at = 0, _next_vertex(data, 0)
    while at >= 0:
        count += 1
        at = _next_vertex(data, at)
    return count


@jit
def _read_vertices(data: ByteArray, vertices: FloatArray) -> bool:
    at, end = 0, data.shape[0]
    for vertex in range(vertices.shape[0]):
        at = _next_vertex(data, at)
        for axis in range(3):
            while at < end and data[at] <= 32:
                at += 1
            value, after = parse_number(data, at, end)
            if after == at or (after < end and data[after] > 32):
                return False
            vertices[vertex, axis] = value
            at = after
    return True


READERS = {"stl": Reader(alone(read_stl), is_stl, may_be_text=True)}
