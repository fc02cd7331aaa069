"""XYZ, PTS and CSV: a point a line, its coordinates first or in the columns that a heading calls x, y and z."""

import re

import numpy as np

from model.errors import UnreadableMeshError
from model.formats._common import Limits, RawMesh, Reader, alone, no_faces
from model.formats._text import as_bytes, parse_numbers, unix_lines
from model.types import FloatArray

_MOST_BROKEN = 0.05
"""Share of the lines that may hold no point."""

_LONGEST_LINE = 1 << 14
_SEPARATORS = bytes.maketrans(b",;\t", b"   ")
_COMMA_BETWEEN_DIGITS = re.compile(rb"[0-9],[0-9]")
_COMMENT = re.compile(rb"//[^\n]*")


def read_xyz(data: bytes, limits: Limits) -> RawMesh:
    """Three numbers a line or more, between blanks, commas, semicolons or tabulators; what stands behind is ignored."""
    if b"\0" in data[:_LONGEST_LINE]:
        raise UnreadableMeshError("The file is no text.")
    data = unix_lines(data)
    limits.check(vertices=0 if limits.max_vertices is None else _least_rows(data))
    places = _heading(data)
    if b"//" in data:
        data = _COMMENT.sub(b"", data) if places is None else data[data.find(b"\n") + 1 :]
    if b";" in data and _COMMA_BETWEEN_DIGITS.search(data[:_LONGEST_LINE]):
        data = data.replace(b",", b".")  # semicolons between numbers with decimal commas
    numbers, lines = parse_numbers(as_bytes(data.translate(_SEPARATORS)))
    points, broken = _rows(numbers, lines, places or (0, 1, 2))
    if not len(points) or broken > _MOST_BROKEN * (len(points) + broken) + 2:
        raise UnreadableMeshError("The lines of the file do not hold three numbers each, the coordinates of a point.")
    return RawMesh(points, no_faces())


def _least_rows(data: bytes) -> int:
    """Lines that can hold a point, at least: blank ones and comments are few."""
    return data.count(b"\n") // 2


def _heading(data: bytes) -> tuple[int, int, int] | None:
    """The columns of x, y and z by the names in the first line, if it has names."""
    line = data[: max(data.find(b"\n", 0, _LONGEST_LINE), 0)].decode("latin-1").lstrip("\ufeff\xef\xbb\xbf#/ ")
    names = [name.strip(" \"'\r") for name in re.split(r"[,;\t]|\s+", line.strip().lower())]
    if all(axis in names for axis in "xyz"):
        return names.index("x"), names.index("y"), names.index("z")
    return None


def _rows(numbers: FloatArray, lines: FloatArray, places: tuple[int, int, int]) -> tuple[FloatArray, int]:
    """Points ``(n, 3)`` of the lines that have numbers in all three places, and how many lines have not."""
    starts = np.flatnonzero(np.diff(lines, prepend=-1))
    lengths = np.diff(starts, append=len(numbers))
    whole = lengths > max(places)
    starts, broken = starts[whole], int((~whole).sum())
    points = np.stack([numbers[starts + place] for place in places], axis=1)
    fine = ~np.isnan(points).any(1)
    return points[fine], broken + int((~fine).sum())


def _never(data: bytes) -> bool:
    """Rows of numbers may be anything: the name has to say what they are."""
    return False


READERS = {name: Reader(alone(read_xyz), _never, may_be_text=True) for name in ("xyz", "pts", "csv")}
