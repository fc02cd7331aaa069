"""OFF: Geomview's object file format in ASCII, with the variants found in the wild."""

import re

import numpy as np

from model._jit import jit
from model.errors import UnreadableMeshError, UnsupportedFormatError
from model.formats._common import Limits, RawMesh, Reader, alone
from model.formats._polygons import triangulate
from model.formats._text import as_bytes, parse_numbers, unix_lines
from model.types import AnyArray, FloatArray

# ST, C, N are texture, colour and normal after the position; 4 a homogeneous coordinate; n a dimension of its own.
# The counts may follow without a blank, as in ModelNet's "OFF4 4 0".
_KEYWORD = re.compile(rb"\A(?:\xef\xbb\xbf)?(?:\s|#[^\n]*\n)*(ST)?(C)?(N)?(4)?(n)?OFF(?![A-Za-z])")


def is_off(data: bytes) -> bool:
    """Whether the text starts with the keyword."""
    return _KEYWORD.match(data[:4096]) is not None


def read_off(data: bytes, limits: Limits) -> RawMesh:
    """Positions and polygons; colours, normals and texture coordinates are passed over."""
    data = unix_lines(data)
    match = _KEYWORD.match(data[:4096])
    if match is None:
        raise UnreadableMeshError("The file does not start with the keyword OFF.")
    if match[4] or match[5]:
        raise UnsupportedFormatError("OFF files with four or n dimensions are not supported.")
    if data[match.end() : match.end() + 64].split()[:1] == [b"BINARY"]:
        raise UnsupportedFormatError("Binary OFF files are not supported; save the mesh as ASCII OFF.")
    numbers, lines = parse_numbers(as_bytes(data[match.end() :]))
    if len(numbers) < 3 or not (numbers[:2] >= 0).all() or not (numbers[:2] <= len(numbers)).all():
        raise UnreadableMeshError("The OFF file has no sensible counts, or is shorter than they say.")
    vertices, faces = int(numbers[0]), int(numbers[1])
    limits.check(vertices, faces)
    # Some writers leave out the number of edges: then the third number stands on a line of its own.
    start = 3 if lines[2] == lines[0] or lines[1] != lines[0] else 2
    positions = np.empty((vertices, 3))
    starts = np.empty(faces, dtype=np.int64)
    lengths = np.empty(faces, dtype=np.int64)
    # Usually every vertex and polygon has a line of its own, and whatever follows on it is colour or the like. Files
    # that break lines elsewhere can only be read by the widths that the keyword announces.
    width = 3 + 2 * bool(match[1]) + 4 * bool(match[2]) + 3 * bool(match[3])
    for by_line in (True, False):
        at = _read_positions(numbers, lines, start, by_line, width, positions)
        if at >= 0 and _find_polygons(numbers, lines, at, by_line, starts, lengths):
            break
    else:
        raise UnreadableMeshError("The OFF file is shorter than its counts say.")
    corners = np.empty(int(lengths.sum()))
    _copy_corners(numbers, starts, lengths, corners)
    triangles = triangulate(positions, corners, lengths, limits)
    return RawMesh(positions, triangles.faces, warnings=triangles.warnings)


@jit
def _read_positions(
    numbers: FloatArray, lines: AnyArray, at: int, by_line: bool, width: int, positions: FloatArray
) -> int:
    """Fill the positions; the place after the last vertex, or -1 where the numbers end too early."""
    end = numbers.shape[0]
    for vertex in range(positions.shape[0]):
        if at + (3 if by_line else width) > end:
            return -1
        for axis in range(3):
            positions[vertex, axis] = numbers[at + axis]
        if by_line:
            at = _next_line(lines, at + 2)
        else:
            at += width
    return at


@jit
def _next_line(lines: AnyArray, at: int) -> int:
    line = lines[at]
    while at < lines.shape[0] and lines[at] == line:
        at += 1
    return at


@jit
def _find_polygons(
    numbers: FloatArray, lines: AnyArray, at: int, by_line: bool, starts: AnyArray, lengths: AnyArray
) -> bool:
    """Place and length of each polygon; False where the numbers end too early."""
    end = numbers.shape[0]
    for face in range(starts.shape[0]):
        if at >= end or not (numbers[at] >= 0 and numbers[at] <= end):
            return False
        length = int(numbers[at])
        if at + 1 + length > end:
            return False
        starts[face], lengths[face] = at + 1, length
        at = _next_line(lines, at + length) if by_line else at + 1 + length
    return True


@jit
def _copy_corners(numbers: FloatArray, starts: AnyArray, lengths: AnyArray, corners: FloatArray) -> None:
    place = 0
    for face in range(starts.shape[0]):
        for corner in range(lengths[face]):
            corners[place] = numbers[starts[face] + corner]
            place += 1


READERS = {"off": Reader(alone(read_off), is_off, may_be_text=True)}
