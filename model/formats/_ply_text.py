"""The data behind the header of an ASCII PLY file."""

from typing import Protocol

import numpy as np

from model._jit import jit
from model.errors import UnreadableMeshError
from model.formats._ply_tables import Element, Lists
from model.types import AnyArray, FloatArray


class Table(Protocol):
    """Hands out the elements of a file in their order."""

    def mark(self) -> tuple[int, int]:
        """Where the next element starts, to come back to."""
        ...

    def rewind(self, mark: tuple[int, int]) -> None:
        """Go back to a mark."""
        ...

    def columns(self, element: Element, places: list[int]) -> list[AnyArray]:
        """The scalar properties at some places; a list counts as an empty column."""
        ...

    def lists(self, element: Element, wanted: int) -> Lists:
        """One list property of every row."""
        ...

    def skip(self, element: Element) -> None:
        """Pass over an element nobody needs."""
        ...


class LineTable:
    """Hands out the elements of an ASCII file in their order, a row a line.

    Attributes:
        longer: how many lines held more words than their row has.
    """

    def __init__(self, numbers: FloatArray, lines: AnyArray) -> None:
        self._numbers = numbers
        # Where each line with numbers starts, and the end.
        self._starts = np.append(np.flatnonzero(np.diff(lines, prepend=-1)), len(numbers))
        self._line = 0
        self.longer = 0

    def mark(self) -> tuple[int, int]:
        """Where the next element starts, to come back to."""
        return self._line, self.longer

    def rewind(self, mark: tuple[int, int]) -> None:
        """Go back to a mark."""
        self._line, self.longer = mark

    def columns(self, element: Element, places: list[int]) -> list[AnyArray]:
        """The scalar properties at some places; a list counts as an empty column."""
        rows, result = self._rows(element), list[AnyArray]()
        for index in places:
            starts, _ = self._walk(element, rows, index)
            result.append(np.empty(0) if element.properties[index].count else self._numbers[starts])
        self._advance(element, rows)
        return result

    def lists(self, element: Element, wanted: int) -> Lists:
        """One list property of every row."""
        rows = self._rows(element)
        starts, lengths = self._walk(element, rows, wanted)
        self._advance(element, rows)
        items = np.empty(int(lengths.sum()))
        _copy_words(self._numbers, starts, lengths, items)
        return Lists(items, lengths)

    def skip(self, element: Element) -> None:
        """Pass over an element nobody needs."""
        if element.properties:
            rows = self._rows(element)
            self._walk(element, rows, 0)
            self._advance(element, rows)

    def _rows(self, element: Element) -> AnyArray:
        """Where each row starts, and the end of the last one."""
        if self._line + element.rows >= len(self._starts):
            raise UnreadableMeshError("The PLY file is shorter than its header says.")
        return self._starts[self._line : self._line + element.rows + 1]

    def _walk(self, element: Element, rows: AnyArray, wanted: int) -> tuple[AnyArray, AnyArray]:
        """Place and length of a property in every row."""
        is_list = np.array([entry.count is not None for entry in element.properties], dtype=np.bool_)
        starts = np.empty(element.rows, dtype=np.int64)
        lengths = np.empty(element.rows, dtype=np.int64)
        self._longer = _walk_lines(self._numbers, rows, is_list, wanted, starts, lengths)
        if self._longer < 0:
            raise UnreadableMeshError("The PLY file has a line that is shorter than its header says.")
        return starts, lengths

    def _advance(self, element: Element, rows: AnyArray) -> None:
        self._line += element.rows
        self.longer += self._longer


@jit
def _walk_row(
    numbers: AnyArray,
    at: int,
    end: int,
    is_list: AnyArray,
    wanted: int,
    row: int,
    starts: AnyArray,
    lengths: AnyArray,
) -> int:
    """Fill place and length of property ``wanted`` of one row; where the row ends, or -1 where it has too few words."""
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
def _walk_lines(
    numbers: AnyArray, rows: AnyArray, is_list: AnyArray, wanted: int, starts: AnyArray, lengths: AnyArray
) -> int:
    """Fill places and lengths of property ``wanted``; how many rows have words left, or -1 where one has too few."""
    longer = 0
    for row in range(starts.shape[0]):
        at = _walk_row(numbers, rows[row], rows[row + 1], is_list, wanted, row, starts, lengths)
        if at < 0:
            return -1
        longer += at < rows[row + 1]
    return longer


class WordTable:
    """Hands out the elements of an ASCII file in their order, word after word, wherever lines break."""

    def __init__(self, numbers: FloatArray) -> None:
        self._numbers = numbers
        self._at = 0

    def mark(self) -> tuple[int, int]:
        """Where the next element starts, to come back to."""
        return self._at, 0

    def rewind(self, mark: tuple[int, int]) -> None:
        """Go back to a mark."""
        self._at = mark[0]

    def columns(self, element: Element, places: list[int]) -> list[AnyArray]:
        """The scalar properties at some places; a list counts as an empty column."""
        width = len(element.properties)
        if any(entry.count for entry in element.properties):
            start = self._at
            result: list[AnyArray] = []
            for index in places:
                self._at = start
                lists = self.lists(element, index)
                result.append(np.empty(0) if element.properties[index].count else lists.items)
            return result
        self._need(element.rows * width)
        rows = self._numbers[self._at : self._at + element.rows * width].reshape(element.rows, width)
        self._at += element.rows * width
        return [rows[:, index] for index in places]

    def lists(self, element: Element, wanted: int) -> Lists:
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
        return Lists(items, lengths)

    def skip(self, element: Element) -> None:
        """Pass over an element nobody needs."""
        if element.properties:
            self.lists(element, 0)

    def _need(self, words: int) -> None:
        if words > len(self._numbers) - self._at:
            raise UnreadableMeshError("The PLY file is shorter than its header says.")


@jit
def _walk_words(numbers: AnyArray, at: int, is_list: AnyArray, wanted: int, starts: AnyArray, lengths: AnyArray) -> int:
    end = numbers.shape[0]
    for row in range(starts.shape[0]):
        at = _walk_row(numbers, at, end, is_list, wanted, row, starts, lengths)
        if at < 0:
            return -1
    return at


@jit
def _copy_words(numbers: AnyArray, starts: AnyArray, lengths: AnyArray, result: AnyArray) -> None:
    place = 0
    for row in range(starts.shape[0]):
        for word in range(lengths[row]):
            result[place] = numbers[starts[row] + word]
            place += 1
