"""The data behind a PLY header: elements one after the other, in binary."""

from dataclasses import dataclass, field

import numpy as np

from model._jit import jit
from model.errors import UnreadableMeshError
from model.types import AnyArray, ByteArray


@dataclass(frozen=True, slots=True)
class Property:
    """One property of an element."""

    name: str
    item: str  # numpy type code without byte order
    count: str | None  # type of the length, for a list


@dataclass(slots=True)
class Element:
    """One element of the header: how many rows, and what is in each."""

    name: str
    rows: int
    properties: list[Property] = field(default_factory=list[Property])

    def find(self, *names: str) -> int:
        """Place of the first property with one of the names, or -1."""
        for index, entry in enumerate(self.properties):
            if entry.name in names:
                return index
        return -1


@dataclass(frozen=True, slots=True)
class Lists:
    """One list property of all rows: items in a row, and how many belong to each row."""

    items: AnyArray
    lengths: AnyArray


class BinaryTable:
    """Hands out the elements of a binary file in their order; sizes are checked before anything is allocated."""

    def __init__(self, data: bytes, start: int, order: str) -> None:
        self._data = data
        self._at = start
        self._order = order

    def mark(self) -> tuple[int, int]:
        """Where the next element starts, to come back to."""
        return self._at, 0

    def rewind(self, mark: tuple[int, int]) -> None:
        """Go back to a mark."""
        self._at = mark[0]

    def columns(self, element: Element, places: list[int]) -> list[AnyArray]:
        """The scalar properties at some places; a list counts as an empty column."""
        if any(entry.count for entry in element.properties):
            columns = [self._scalar(element, index) for index in places]
            self.skip(element)
            return columns
        rows = self._records(element, {})
        return [rows[f"p{index}"] for index in places]

    def lists(self, element: Element, wanted: int) -> Lists:
        """One list property of every row."""
        fixed = self._equal_lengths(element)
        if fixed is not None:
            start = self._at
            rows = self._records(element, fixed)
            if all((rows[f"c{index}"] == length).all() for index, length in fixed.items()):
                lengths = np.full(element.rows, fixed[wanted], dtype=np.int64)
                return Lists(rows[f"p{wanted}"].reshape(-1), lengths)
            self._at = start
        starts, lengths = self._walk(element, wanted, advance=True)
        return Lists(self._gather(starts, lengths, element.properties[wanted].item), lengths)

    def skip(self, element: Element) -> None:
        """Pass over an element nobody needs."""
        if any(entry.count for entry in element.properties):
            self._walk(element, 0, advance=True)
        else:
            self._records(element, {})

    def _scalar(self, element: Element, wanted: int) -> AnyArray:
        starts, lengths = self._walk(element, wanted, advance=False)
        if element.properties[wanted].count:
            return np.empty(0)
        return self._gather(starts, lengths, element.properties[wanted].item)

    def _records(self, element: Element, lengths: dict[int, int]) -> AnyArray:
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

    def _equal_lengths(self, element: Element) -> dict[int, int] | None:
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

    def _walk(self, element: Element, wanted: int, advance: bool) -> tuple[AnyArray, AnyArray]:
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
