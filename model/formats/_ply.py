"""PLY: ASCII and binary of both byte orders, any element and property layout."""

import re

import numpy as np

from model.errors import UnreadableMeshError
from model.formats._common import Limits, RawMesh, Reader, fan, no_faces, strip, to_float64
from model.formats._ply_tables import BinaryTable, Element, Lists, Property, TextTable
from model.types import AnyArray, IntArray

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8", "int64": "i8", "uint64": "u8",
}  # fmt: skip
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": None}
_LONGEST_HEADER = 1 << 20
_MOST_PROPERTIES = 1000


def is_ply(data: bytes) -> bool:
    """Whether the first line is the format's name."""
    return re.match(rb"ply[ \t]*[\r\n]", data) is not None


def read_ply(data: bytes, limits: Limits) -> RawMesh:
    """Faces from the element ``face`` (polygons become fans) and from ``tristrips``."""
    order, elements, start = _read_header(data)
    for element in elements:
        if element.name == "vertex":
            limits.check(vertices=element.rows)
        elif element.name == "face":
            limits.check(faces=element.rows)
    table = BinaryTable(data, start, order) if order else TextTable(data, start)
    vertices: AnyArray = np.empty((0, 3))
    faces: list[IntArray] = []
    for element in elements:
        wanted = element.find("vertex_indices", "vertex_index")
        if element.name == "vertex":
            places = [element.find(axis) for axis in "xyz"]
            if min(places) < 0:
                raise UnreadableMeshError("The PLY file has vertices without x, y or z.")
            vertices = to_float64(table.columns(element, places))
        elif element.name == "face" and wanted >= 0 and element.properties[wanted].count:
            lists = table.lists(element, wanted)
            faces.append(fan(lists.items, lists.lengths, limits))
        elif element.name == "tristrips" and wanted >= 0 and element.properties[wanted].count:
            faces.extend(_strips(table.lists(element, wanted)))
        else:
            table.skip(element)
    return RawMesh(vertices, np.concatenate(faces) if faces else no_faces())


def _read_header(data: bytes) -> tuple[str | None, list[Element], int]:
    """Byte order (None for ASCII), elements, and where the data starts."""
    end = data.find(b"end_header", 0, _LONGEST_HEADER)
    newline = data.find(b"\n", end, end + 64)
    if not data.startswith(b"ply") or end < 0:
        raise UnreadableMeshError("The PLY file has no complete header.")
    start = newline + 1 if newline >= 0 else len(data)
    if newline < 0 or data[end:newline].strip() != b"end_header":  # old files end their lines with a carriage return
        start = end + len(b"end_header") + 1
    order: str | None = ""
    elements: list[Element] = []
    for line in data[:end].decode("latin-1").replace("\r", "\n").split("\n"):
        words = line.split()
        try:
            if words[:1] == ["format"]:
                order = _ORDERS[words[1]]
            elif words[:1] == ["element"]:
                elements.append(Element(words[1], int(words[2])))
            elif words[:2] == ["property", "list"]:
                elements[-1].properties.append(Property(words[4], _TYPES[words[3]], _TYPES[words[2]]))
            elif words[:1] == ["property"]:
                elements[-1].properties.append(Property(words[2], _TYPES[words[1]], None))
        except (KeyError, IndexError, ValueError) as error:
            raise UnreadableMeshError("The PLY header has a line that is not understood.") from error
    if sum(len(element.properties) for element in elements) > _MOST_PROPERTIES:
        raise UnreadableMeshError(f"The PLY header has more than {_MOST_PROPERTIES} properties.")
    if order == "":
        raise UnreadableMeshError("The PLY header names no format.")
    if any(element.rows < 0 for element in elements):
        raise UnreadableMeshError("The PLY header has a negative count.")
    return order, elements, start


def _strips(lists: Lists) -> list[IntArray]:
    """Triangles of strips; -1 ends a strip inside a list."""
    result: list[IntArray] = []
    for row in np.split(lists.items.astype(np.int32), np.cumsum(lists.lengths)[:-1]):
        ends = np.flatnonzero(row == -1)
        result += [strip(part[part >= 0]) for part in np.split(row, ends)]
    return result


READERS = {"ply": Reader(read_ply, is_ply)}
