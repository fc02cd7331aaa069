"""PLY: ASCII and binary of both byte orders, any element and property layout."""

from dataclasses import dataclass, field

import numpy as np

from model._jit import jit
from model.errors import UnreadableMeshError
from model.formats._common import Limits, RawMesh, fan, no_faces, strip, to_float64
from model.formats._text import parse_numbers
from model.types import AnyArray, ByteArray, IntArray

_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8", "int64": "i8", "uint64": "u8",
}  # fmt: skip
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">", "ascii": None}
_LONGEST_HEADER = 1 << 20


@dataclass(frozen=True, slots=True)
class _Property:
    name: str
    item: str  # numpy type code without byte order
    count: str | None  # type of the length, for a list


@dataclass(slots=True)
class _Element:
    name: str
    rows: int
    properties: list[_Property] = field(default_factory=list[_Property])

    def find(self, *names: str) -> int:
        for index, entry in enumerate(self.properties):
            if entry.name in names:
                return index
        return -1


@dataclass(frozen=True, slots=True)
class _Lists:
    """One list property of all rows: items in a row, and how many belong to each row."""

    items: AnyArray
    lengths: AnyArray


def read_ply(data: bytes, limits: Limits) -> RawMesh:
    """Faces from the element ``face`` (polygons become fans) and from ``tristrips``."""
    order, elements, start = _read_header(data)
    for element in elements:
        if element.name == "vertex":
            limits.check(vertices=element.rows)
        elif element.name == "face":
            limits.check(faces=element.rows)
    table = _BinaryTable(data, start, order) if order else _TextTable(data, start)
    vertices: AnyArray = np.empty((0, 3))
    faces: list[IntArray] = []
    for element in elements:
        wanted = element.find("vertex_indices", "vertex_index")
        if element.name == "vertex":
            places = [element.find(axis) for axis in "xyz"]
            if min(places) < 0:
                raise UnreadableMeshError("The PLY file has vertices without x, y or z.")
            columns = table.columns(element)
            vertices = to_float64([columns[place] for place in places])
        elif element.name == "face" and wanted >= 0 and element.properties[wanted].count:
            lists = table.lists(element, wanted)
            faces.append(fan(lists.items, lists.lengths, limits))
        elif element.name == "tristrips" and wanted >= 0 and element.properties[wanted].count:
            faces.extend(_strips(table.lists(element, wanted)))
        else:
            table.skip(element)
    return RawMesh(vertices, np.concatenate(faces) if faces else no_faces())


def _read_header(data: bytes) -> tuple[str | None, list[_Element], int]:
    """Byte order (None for ASCII), elements, and where the data starts."""
    end = data.find(b"end_header", 0, _LONGEST_HEADER)
    newline = data.find(b"\n", end, end + 64)
    if not data.startswith(b"ply") or end < 0:
        raise UnreadableMeshError("The PLY file has no complete header.")
    start = newline + 1 if newline >= 0 else len(data)
    if newline < 0 or data[end:newline].strip() != b"end_header":  # old files end their lines with a carriage return
        start = end + len(b"end_header") + 1
    order: str | None = ""
    elements: list[_Element] = []
    for line in data[:end].decode("latin-1").replace("\r", "\n").split("\n"):
        words = line.split()
        try:
            if words[:1] == ["format"]:
                order = _ORDERS[words[1]]
            elif words[:1] == ["element"]:
                elements.append(_Element(words[1], int(words[2])))
            elif words[:2] == ["property", "list"]:
                elements[-1].properties.append(_Property(words[4], _TYPES[words[3]], _TYPES[words[2]]))
            elif words[:1] == ["property"]:
                elements[-1].properties.append(_Property(words[2], _TYPES[words[1]], None))
        except (KeyError, IndexError, ValueError) as error:
            raise UnreadableMeshError("The PLY header has a line that is not understood.") from error
    if order == "":
        raise UnreadableMeshError("The PLY header names no format.")
    if any(element.rows < 0 for element in elements):
        raise UnreadableMeshError("The PLY header has a negative count.")
    return order, elements, start


def _strips(lists: _Lists) -> list[IntArray]:
    """Triangles of strips; -1 ends a strip inside a list."""
    result: list[IntArray] = []
    for row in np.split(lists.items.astype(np.int32), np.cumsum(lists.lengths)[:-1]):
        ends = np.flatnonzero(row == -1)
        result += [strip(part[part >= 0]) for part in np.split(row, ends)]
    return result


class _BinaryTable:
    """Hands out the elements of a binary file in their order; sizes are checked before anything is allocated."""

    def __init__(self, data: bytes, start: int, order: str) -> None:
        self._data = data
        self._at = start
        self._order = order

    def columns(self, element: _Element) -> list[AnyArray]:
        """All scalar properties; a list counts as an empty column."""
        if any(entry.count for entry in element.properties):
            return [self._scalar(element, index) for index in range(len(element.properties) - 1)] + [
                self._scalar(element, len(element.properties) - 1, advance=True)
            ]
        rows = self._records(element, {})
        return [rows[f"p{index}"] for index in range(len(element.properties))]

    def lists(self, element: _Element, wanted: int) -> _Lists:
        """One list property of every row."""
        fixed = self._equal_lengths(element)
        if fixed is not None:
            start = self._at
            rows = self._records(element, fixed)
            if all((rows[f"c{index}"] == length).all() for index, length in fixed.items()):
                lengths = np.full(element.rows, fixed[wanted], dtype=np.int64)
                return _Lists(rows[f"p{wanted}"].reshape(-1), lengths)
            self._at = start
        starts, lengths = self._walk(element, wanted, advance=True)
        return _Lists(self._gather(starts, lengths, element.properties[wanted].item), lengths)

    def skip(self, element: _Element) -> None:
        """Pass over an element nobody needs."""
        if any(entry.count for entry in element.properties):
            self._walk(element, 0, advance=True)
        else:
            self._records(element, {})

    def _scalar(self, element: _Element, wanted: int, advance: bool = False) -> AnyArray:
        starts, lengths = self._walk(element, wanted, advance)
        if element.properties[wanted].count:
            return np.empty(0)
        return self._gather(starts, lengths, element.properties[wanted].item)

    def _records(self, element: _Element, lengths: dict[int, int]) -> AnyArray:
        """The rows as structured records, given the length of every list: fields p<i>, and c<i> for a list's length."""
        fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
        for index, entry in enumerate(element.properties):
            if entry.count:
                fields.append((f"c{index}", self._order + entry.count))
                fields.append((f"p{index}", self._order + entry.item, (lengths[index],)))
            else:
                fields.append((f"p{index}", self._order + entry.item))
        dtype = np.dtype(fields)
        if element.rows * dtype.itemsize > len(self._data) - self._at:
            raise UnreadableMeshError("The PLY file is shorter than its header says.")
        if dtype.itemsize == 0:
            return np.empty(0, dtype)
        records = np.frombuffer(self._data, dtype, element.rows, self._at)
        self._at += element.rows * dtype.itemsize
        return records

    def _equal_lengths(self, element: _Element) -> dict[int, int] | None:
        """The list lengths of the first row, or None if not all rows could have them."""
        lengths: dict[int, int] = {}
        at, size = self._at, 0
        for index, entry in enumerate(element.properties):
            if entry.count:
                dtype = np.dtype(self._order + entry.count)
                if entry.count[0] == "f" or at + dtype.itemsize > len(self._data):
                    return None
                lengths[index] = int(np.frombuffer(self._data, dtype, 1, at)[0])
                if not 0 <= lengths[index] <= 64:
                    return None
                at += dtype.itemsize
            at += np.dtype(entry.item).itemsize * lengths.get(index, 1)
            size = at - self._at
        return lengths if element.rows * size <= len(self._data) - self._at else None

    def _walk(self, element: _Element, wanted: int, advance: bool) -> tuple[AnyArray, AnyArray]:
        """Offset and length of one property in every row, whatever the lists."""
        smallest = sum(np.dtype(entry.count or entry.item).itemsize for entry in element.properties)
        if element.rows * max(smallest, 1) > len(self._data) - self._at:
            raise UnreadableMeshError("The PLY file is shorter than its header says.")
        if any(entry.count and entry.count[0] == "f" for entry in element.properties):
            raise UnreadableMeshError("The PLY header has a list whose length is no integer.")
        counts = np.array([np.dtype(entry.count).itemsize if entry.count else 0 for entry in element.properties])
        sizes = np.array([np.dtype(entry.item).itemsize for entry in element.properties])
        starts = np.empty(element.rows, dtype=np.int64)
        lengths = np.empty(element.rows, dtype=np.int64)
        raw = np.frombuffer(self._data, np.uint8)
        end = _walk_rows(raw, self._at, counts, sizes, wanted, self._order == ">", starts, lengths)
        if end < 0:
            raise UnreadableMeshError("The PLY file is shorter than its lists say.")
        if advance:
            self._at = end
        return starts, lengths

    def _gather(self, starts: AnyArray, lengths: AnyArray, item: str) -> AnyArray:
        dtype = np.dtype(self._order + item)
        result = np.empty(int(lengths.sum()) * dtype.itemsize, dtype=np.uint8)
        _copy_items(np.frombuffer(self._data, np.uint8), starts, lengths * dtype.itemsize, result)
        return result.view(dtype)


@jit
def _walk_rows(
    data: ByteArray,
    at: int,
    counts: AnyArray,
    sizes: AnyArray,
    wanted: int,
    big_endian: bool,
    starts: AnyArray,
    lengths: AnyArray,
) -> int:
    """Fill offsets and lengths of property `wanted`; the end of the element, or -1 where the data end too early."""
    end = data.shape[0]
    for row in range(starts.shape[0]):
        for entry in range(sizes.shape[0]):
            length = 1
            width = counts[entry]
            if width > 0:
                if at + width > end:
                    return -1
                length = 0
                for byte in range(width):
                    place = at + byte if big_endian else at + width - 1 - byte
                    length = (length << 8) | int(data[place])
                at += width
                if length < 0 or length > end:  # a negative length reads as a huge one
                    return -1
            if at + length * sizes[entry] > end:
                return -1
            if entry == wanted:
                starts[row], lengths[row] = at, length
            at += length * sizes[entry]
    return at


@jit
def _copy_items(data: ByteArray, starts: AnyArray, sizes: AnyArray, result: ByteArray) -> None:
    place = 0
    for row in range(starts.shape[0]):
        for byte in range(sizes[row]):
            result[place] = data[starts[row] + byte]
            place += 1


class _TextTable:
    """The same for ASCII, where every value is a word."""

    def __init__(self, data: bytes, start: int) -> None:
        self._numbers = parse_numbers(np.frombuffer(data, np.uint8)[start:])[0]
        self._at = 0

    def columns(self, element: _Element) -> list[AnyArray]:
        """All scalar properties; a list counts as an empty column."""
        width = len(element.properties)
        if any(entry.count for entry in element.properties):
            start = self._at
            result: list[AnyArray] = []
            for index, entry in enumerate(element.properties):
                self._at = start
                lists = self.lists(element, index)
                result.append(np.empty(0) if entry.count else lists.items)
            return result
        self._need(element.rows * width)
        rows = self._numbers[self._at : self._at + element.rows * width].reshape(element.rows, width)
        self._at += element.rows * width
        return [rows[:, index] for index in range(width)]

    def lists(self, element: _Element, wanted: int) -> _Lists:
        """One property of every row."""
        self._need(element.rows * len(element.properties))
        is_list = np.array([entry.count is not None for entry in element.properties])
        starts = np.empty(element.rows, dtype=np.int64)
        lengths = np.empty(element.rows, dtype=np.int64)
        end = _walk_words(self._numbers, self._at, is_list, wanted, starts, lengths)
        if end < 0:
            raise UnreadableMeshError("The PLY file is shorter than its lists say.")
        self._at = end
        items = np.empty(int(lengths.sum()))
        _copy_words(self._numbers, starts, lengths, items)
        return _Lists(items, lengths)

    def skip(self, element: _Element) -> None:
        """Pass over an element nobody needs."""
        if element.properties:
            self.lists(element, 0)

    def _need(self, words: int) -> None:
        if words > len(self._numbers) - self._at:
            raise UnreadableMeshError("The PLY file is shorter than its header says.")


@jit
def _walk_words(
    numbers: AnyArray, at: int, is_list: AnyArray, wanted: int, starts: AnyArray, lengths: AnyArray
) -> int:
    end = numbers.shape[0]
    for row in range(starts.shape[0]):
        for entry in range(is_list.shape[0]):
            length = 1
            if is_list[entry]:
                if at >= end or not (numbers[at] >= 0 and numbers[at] <= end):
                    return -1
                length = int(numbers[at])
                at += 1
            if at + length > end:
                return -1
            if entry == wanted:
                starts[row], lengths[row] = at, length
            at += length
    return at


@jit
def _copy_words(numbers: AnyArray, starts: AnyArray, lengths: AnyArray, result: AnyArray) -> None:
    place = 0
    for row in range(starts.shape[0]):
        for word in range(lengths[row]):
            result[place] = numbers[starts[row] + word]
            place += 1
