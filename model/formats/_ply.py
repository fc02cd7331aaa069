"""PLY: ASCII and binary of both byte orders, any element and property layout."""

import re
from dataclasses import replace

import numpy as np

from model.errors import UnreadableMeshError
from model.formats._common import Limits, RawMesh, Reader, Resources, no_faces, strip, to_float64
from model.formats._ply_looks import PlyLooks, has_places, picture_names
from model.formats._ply_tables import BinaryTable, Element, Lists, Property
from model.formats._ply_text import LineTable, Table, WordTable
from model.formats._polygons import Triangles, triangulate
from model.formats._text import as_bytes, parse_numbers, unix_lines
from model.types import AnyArray, ByteArray, IntArray

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8", "int64": "i8", "uint64": "u8",
}  # fmt: skip
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": None}
_COLORS = (("red", "diffuse_red", "r"), ("green", "diffuse_green", "g"), ("blue", "diffuse_blue", "b"), ("alpha",))
_LONGEST_HEADER = 1 << 20
_MOST_PROPERTIES = 1000


def is_ply(data: bytes) -> bool:
    """Whether the first line is the format's name."""
    return re.match(rb"ply[ \t]*[\r\n]", data) is not None


def read_ply(data: bytes, limits: Limits, resources: Resources) -> RawMesh:
    """Faces from the element ``face``, which may be any polygons, and from ``tristrips``."""
    order, elements, start = _read_header(data)
    names = picture_names(data[:start]) if start < _LONGEST_HEADER else []
    for element in elements:
        if element.name == "vertex":
            limits.check(vertices=element.rows)
        elif element.name == "face":
            limits.check(faces=element.rows)
    if order:
        return _read_elements(elements, BinaryTable(data, start, order), limits, names, resources)
    numbers, lines = parse_numbers(as_bytes(unix_lines(data[start:])))
    # Every row has a line of its own. Writers that break lines elsewhere are rarer than those of longer rows.
    table = LineTable(numbers, lines)
    try:
        raw = _read_elements(elements, table, limits, names, resources)
    except UnreadableMeshError:
        return _read_elements(elements, WordTable(numbers), limits, names, resources)
    if table.longer:
        warning = f"{table.longer} lines hold more numbers than the PLY header announces; those behind were not read."
        raw = replace(raw, warnings=(*raw.warnings, warning))
    return raw


def _read_elements(
    elements: list[Element], table: Table, limits: Limits, names: list[str], resources: Resources
) -> RawMesh:
    looks = PlyLooks(names if limits.looks else [])
    vertices: AnyArray = np.empty((0, 3))
    colors: ByteArray | None = None
    polygons: list[Lists] = []
    faces: list[IntArray] = []
    for element in elements:
        wanted = element.find("vertex_indices", "vertex_index")
        if element.name == "vertex":
            places = [element.find(axis) for axis in "xyz"]
            if min(places) < 0:
                raise UnreadableMeshError("The PLY file has vertices without x, y or z.")
            tints = [element.find(*names) for names in _COLORS]
            mark = table.mark()
            found = table.columns(element, [*places, *(place for place in tints if place >= 0)])
            vertices = to_float64(found[:3])
            if min(tints[:3]) >= 0:
                colors = _colors(found[3:], [element.properties[place].item for place in tints if place >= 0])
            looks.read_vertices(table, element, mark)
        elif element.name == "face" and wanted >= 0 and element.properties[wanted].count:
            mark = table.mark()
            polygons.append(table.lists(element, wanted))
            looks.read_faces(table, element, mark)
        elif element.name == "tristrips" and wanted >= 0 and element.properties[wanted].count:
            faces.extend(_strips(table.lists(element, wanted)))
        else:
            table.skip(element)
    warnings: tuple[str, ...] = ()
    cut: list[Triangles] = []
    for lists in polygons:  # at the end: the vertices may stand behind them
        triangles = triangulate(vertices, lists.items, lists.lengths, limits)
        cut.append(triangles)
        warnings += triangles.warnings
    painted = not limits.looks and bool(names) and any(map(has_places, elements))
    together = [*faces, *(triangles.faces for triangles in cut)]
    raw = RawMesh(vertices, np.concatenate(together) if together else no_faces(), None, warnings, colors, None, painted)
    if len(polygons) != 1 or faces:  # pictures of strips are not heard of
        return raw
    return looks.laid_on(raw, polygons[0].lengths, cut[0].places, resources)


def _colors(columns: list[AnyArray], kinds: list[str]) -> ByteArray | None:
    """(v, 4) of three or four columns: bytes as they are, 16 bits and fractions scaled."""
    if any(len(column) != len(columns[0]) for column in columns):
        return None  # of a list
    result = np.full((len(columns[0]), 4), 255, dtype=np.uint8)
    for place, (column, kind) in enumerate(zip(columns, kinds, strict=True)):
        scale = 255.0 if kind[0] == "f" else 1.0 / 257.0 if kind == "u2" else 1.0
        values = np.nan_to_num(column.astype(np.float64)) * scale
        result[:, place] = np.clip(np.rint(values), 0, 255)
    return result


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


READERS = {"ply": Reader(read_ply, is_ply, may_be_text=True)}
