"""OBJ: positions and faces of all objects and groups, and their looks where they are wanted; no file is opened."""

import re
from dataclasses import replace

import numpy as np

from model._jit import jit
from model.errors import UnreadableMeshError
from model.formats._common import Limits, RawMesh, Reader, Resources, no_resources
from model.formats._obj_looks import is_painted, with_looks
from model.formats._polygons import triangulate
from model.formats._text import as_bytes, parse_number, unix_lines
from model.types import AnyArray, ByteArray, FloatArray, IntArray

_LINE = re.compile(rb"^[ \t]*(v|f)[ \t]+[-+.0-9]", re.MULTILINE)
_FAULTS = {
    1: "The OBJ file has a vertex without three numbers.",
    2: "The OBJ file has a face that is not understood.",
    3: "The OBJ file has a face that refers to vertex number 0; they count from 1.",
}


def is_obj(data: bytes) -> bool:
    """Whether it is text with a line of a vertex or a face near its beginning."""
    return b"\0" not in data[:1024] and _LINE.search(data[: 1 << 16]) is not None


def read_obj(data: bytes, limits: Limits, resources: Resources = no_resources) -> RawMesh:
    """Faces may be any polygons; negative indices count back from the latest vertex."""
    if b"\0" in data[:4096]:
        raise UnreadableMeshError("The OBJ file is not text.")
    data = unix_lines(data)
    raw = as_bytes(data)
    vertex_count, polygon_count, corner_count, triangle_count = _count(raw)
    limits.check(vertex_count, triangle_count)
    vertices = np.empty((vertex_count, 3))
    tints = np.empty((vertex_count, 3))
    corners = np.empty(corner_count, dtype=np.int32)
    lengths, starts = np.empty(polygon_count, dtype=np.int64), np.empty(polygon_count, dtype=np.int64)
    fault = _read(raw, vertices, tints, corners, lengths, starts)
    if fault:
        raise UnreadableMeshError(_FAULTS[fault])
    triangles = triangulate(vertices, corners, lengths, limits)
    mesh = RawMesh(vertices, triangles.faces, warnings=triangles.warnings, colors=_colors(tints))
    if not limits.looks:
        return replace(mesh, painted=is_painted(data, resources))
    places = triangles.places
    if places is None:
        places = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    return with_looks(raw.tobytes(), mesh, starts, lengths, places, resources)


def _colors(tints: FloatArray) -> ByteArray | None:
    """(v, 4) where every vertex has three numbers from 0 to 1 or, in some programs, to 255."""
    if not len(tints) or not np.isfinite(tints).all() or tints.min() < 0.0:
        return None
    scale = 255.0 if tints.max() <= 1.0 else 1.0
    result = np.full((len(tints), 4), 255, dtype=np.uint8)
    result[:, :3] = np.clip(np.rint(scale * tints), 0, 255)
    return result


@jit
def _blanks(data: ByteArray, at: int) -> int:
    """The next word of the line, or the line's end; a backslash before the line break continues the line."""
    end = data.shape[0]
    while at < end:
        byte = data[at]
        if byte <= 32 and byte != 10:
            at += 1
        elif byte == 92 and at + 1 < end and data[at + 1] == 10:
            at += 2
        elif byte == 92 and at + 2 < end and data[at + 1] == 13 and data[at + 2] == 10:
            at += 3
        else:
            break
    return at


@jit
def _line_end(data: ByteArray, at: int) -> int:
    """The place after the line's break."""
    end = data.shape[0]
    while at < end:
        if data[at] == 10:
            # A comment or a material name may end in a backslash too: then the next line is part of it.
            continued = at > 0 and (data[at - 1] == 92 or (data[at - 1] == 13 and at > 1 and data[at - 2] == 92))
            if not continued:
                return at + 1
        at += 1
    return at


@jit
def _keyword(data: ByteArray, at: int) -> int:
    """1 for a vertex, 2 for a face, 0 for any other line."""
    if at + 1 < data.shape[0] and (data[at + 1] == 32 or data[at + 1] == 9 or data[at + 1] == 92):
        if data[at] == 118:
            return 1
        if data[at] == 102:
            return 2
    return 0


@jit
def _ends(data: ByteArray, at: int) -> bool:
    """Whether the line, or what counts of it, ends here."""
    return at >= data.shape[0] or data[at] == 10 or data[at] == 35


@jit
def _count(data: ByteArray) -> tuple[int, int, int, int]:
    """Vertices, polygons, their corners, and the triangles they become."""
    at, vertices, polygons, total, triangles = 0, 0, 0, 0, 0
    while at < data.shape[0]:
        at = _blanks(data, at)
        kind = _keyword(data, at)
        if kind == 1:
            vertices += 1
        elif kind == 2:
            corners = 0
            at = _blanks(data, at + 1)
            while not _ends(data, at):
                corners += 1
                at = _blanks(data, _word_end(data, at))
            polygons += 1
            total += corners
            triangles += max(corners - 2, 0)
        at = _line_end(data, at)
    return vertices, polygons, total, triangles


@jit
def _word_end(data: ByteArray, at: int) -> int:
    while at < data.shape[0] and data[at] > 32 and data[at] != 35:
        if data[at] == 92:  # only a line break makes it more than a character
            after = _blanks(data, at)
            if after > at:
                return at
        at += 1
    return at


@jit
def _read(
    data: ByteArray, vertices: FloatArray, tints: FloatArray, corners: IntArray, lengths: AnyArray, starts: AnyArray
) -> int:
    """Fill vertices and polygons; 0, or the number of a fault."""
    at, vertex, polygon, corner = 0, 0, 0, 0
    end = data.shape[0]
    while at < end:
        at = _blanks(data, at)
        kind = _keyword(data, at)
        if kind == 1:
            at += 1
            for axis in range(3):
                at = _blanks(data, at)
                value, after = parse_number(data, at, end)
                if after == at or after != _word_end(data, after):
                    return 1
                vertices[vertex, axis] = value
                at = after
            for channel in range(3):  # red, green and blue behind the position; one number alone is a weight
                at = _blanks(data, at)
                value, after = parse_number(data, at, end)
                fine = after > at and after == _word_end(data, after)
                tints[vertex, channel] = value if fine else np.nan
                at = after if fine else at
            vertex += 1
        elif kind == 2:
            first, starts[polygon] = corner, at
            at = _blanks(data, at + 1)
            while not _ends(data, at):
                negative = data[at] == 45
                at += negative
                index, digits = 0, 0
                while at < end and 48 <= data[at] <= 57:
                    index = min(index * 10 + int(data[at] - 48), 1 << 31)
                    digits += 1
                    at += 1
                if digits == 0 or (at < end and data[at] > 32 and data[at] != 47 and data[at] != 35 and data[at] != 92):
                    return 2
                if index == 0:
                    return 3
                # Out of range becomes -1, which no mesh accepts.
                index = vertex - index if negative else index - 1
                index = index if 0 <= index < vertices.shape[0] else -1
                at = _blanks(data, _word_end(data, at))  # passes over /texture/normal
                corners[corner] = index
                corner += 1
            lengths[polygon] = corner - first
            polygon += 1
        at = _line_end(data, at)
    return 0


READERS = {"obj": Reader(read_obj, is_obj, may_be_text=True)}
