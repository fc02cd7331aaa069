"""Looks of 3MF: colours and places in pictures, and which of them the corners of triangles have."""

from array import array
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from model.meshes.colors import distinct_rows
from model.types import AnyArray, BoolArray, ByteArray, FloatArray, IntArray

_WHITE = (255.0, 255.0, 255.0, 255.0)
_ROW = 7
"""Red, green, blue, opacity, number of a picture in its part (-1 for none), and two numbers where in it."""

_FARTHEST = 1e6
"""Places in a picture beyond are none."""

_STEPS = 1 << 16
"""Places that differ by less than one part of so many are one."""

_GROUPS = {
    "basematerials": "base",
    "colorgroup": "color",
    "texture2dgroup": "tex2coord",
    "compositematerials": "composite",
    "multiproperties": "multi",
}
"""Groups of looks, and what each of their entries is called."""


@dataclass(frozen=True, slots=True, eq=False)
class Painted:
    """Looks of triangles: colours ``(f, 3, 4)`` and places ``(f, 3, 2)`` of corners, pictures ``(f,)``, -1 for none."""

    colors: ByteArray
    places: FloatArray
    pictures: IntArray

    def part(self, kept: BoolArray) -> "Painted":
        """That of some of the triangles."""
        return Painted(self.colors[kept], self.places[kept], self.pictures[kept])

    def turned(self) -> "Painted":
        """That of the triangles with their corners the other way round."""
        return Painted(self.colors[:, ::-1], self.places[:, ::-1], self.pictures)

    def put(self, start: int, other: "Painted") -> None:
        """Let other triangles begin at one of these."""
        end = start + len(other.pictures)
        self.colors[start:end], self.places[start:end] = other.colors, other.places
        self.pictures[start:end] = other.pictures


def plain(count: int) -> Painted:
    """Looks of so many triangles that have none."""
    colors = np.full((count, 3, 4), 255, dtype=np.uint8)
    return Painted(colors, np.zeros((count, 3, 2)), np.full(count, -1, dtype=np.int32))


@dataclass(slots=True)
class Palette:
    """The looks of one part of a package, by the number of their group.

    Attributes:
        wanted: whether they are kept, or only counted.
        check: told how many entries there are, to refuse too many.
        textures: which part of the package each picture is, by its number.
        numbers: which of all pictures that are at hand each of them is, -1 for none.
        entries: how many colours and places there are.
    """

    wanted: bool
    check: Callable[[int], None]
    textures: dict[int, str] = field(default_factory=dict[int, str])
    numbers: dict[int, int] = field(default_factory=dict[int, int])
    entries: int = 0
    _groups: dict[int, "array[float]"] = field(default_factory=dict[int, "array[float]"])
    _open: int = -1
    _entry: str = ""
    _attributes: dict[str, str] = field(default_factory=dict[str, str])

    def begin(self, name: str, attributes: dict[str, str]) -> None:
        """An element starts."""
        if name == "texture2d":
            self.textures[number(attributes.get("id"))] = attributes.get("path", "")
        elif name in _GROUPS:
            self._open, self._entry, self._attributes = number(attributes.get("id")), _GROUPS[name], attributes
            self._groups.setdefault(self._open, array("d"))
        elif name == self._entry:
            self.entries += 1
            self.check(self.entries)
            if self.wanted:
                try:
                    self._groups[self._open].extend(self._row(name, attributes))
                except (ValueError, KeyError, OverflowError):  # broken looks cost the looks
                    self._groups[self._open].extend((*_WHITE, -1.0, 0.0, 0.0))

    def corners(self, paints: AnyArray) -> Painted:
        """Looks of triangles by group and three entries of it (f, 4)."""
        rows = np.full((len(paints), 3, _ROW), [*_WHITE, -1.0, 0.0, 0.0])
        for group, entries in self._groups.items():
            table = np.array(entries).reshape(-1, _ROW)
            own = np.flatnonzero(paints[:, 0] == group)
            if not len(table) or not len(own):
                continue
            which = paints[own, 1:]
            which = np.where(which < 0, which[:, :1], which)  # one for all three
            found = (which >= 0) & (which < len(table))
            rows[own] = np.where(found[..., None], table[np.clip(which, 0, len(table) - 1)], rows[own])
        own = rows[:, :, 4].astype(np.int64)
        number_of = {-1: -1, **self.numbers}
        known, where = np.unique(own, return_inverse=True)
        numbers = np.array([number_of.get(each, -1) for each in known.tolist()], dtype=np.int32)
        found = numbers[where.reshape(own.shape)] if len(known) else own.astype(np.int32)
        same = (found == found[:, :1]).all(axis=1)
        colors = np.clip(np.rint(rows[:, :, :4]), 0, 255).astype(np.uint8)
        return Painted(colors, rows[:, :, 5:], np.where(same, found[:, 0], -1).astype(np.int32))

    def _row(self, name: str, attributes: dict[str, str]) -> tuple[float, ...]:
        if name == "tex2coord":
            u, v = float(attributes["u"]), float(attributes["v"])
            if not (abs(u) < _FARTHEST and abs(v) < _FARTHEST):
                raise ValueError
            return (*_WHITE, number(self._attributes.get("texid")), u, 1.0 - v)  # 3MF counts from below
        if name == "composite":
            return self._composite([float(value) for value in attributes["values"].split()])
        if name == "multi":
            return self._layers([int(value) for value in attributes["pindices"].split()])
        return (*_color(attributes["displaycolor" if name == "base" else "color"]), -1.0, 0.0, 0.0)

    def _composite(self, shares: list[float]) -> tuple[float, ...]:
        """The mean of base materials."""
        base = number(self._attributes["matid"])
        entries = [int(value) for value in self._attributes["matindices"].split()]
        rows = [self._entry_of(base, entry) for entry in entries[: len(shares)]]
        total = sum(shares)
        if not total > 0.0:
            raise ValueError
        mixed = [sum(share * row[k] for share, row in zip(shares, rows, strict=False)) / total for k in range(4)]
        return (*mixed, -1.0, 0.0, 0.0)

    def _layers(self, entries: list[int]) -> tuple[float, ...]:
        """Looks on top of each other, the lowest first: mixed, which shows the upper one, or multiplied."""
        groups = [number(value) for value in self._attributes["pids"].split()]
        ways = ["mix", *self._attributes.get("blendmethods", "").split()]
        result: list[float] = [*_WHITE, -1.0, 0.0, 0.0]
        for layer, group in enumerate(groups):
            row = self._entry_of(group, entries[layer] if layer < len(entries) else 0)
            multiplied = layer < len(ways) and ways[layer] == "multiply"
            color = [a * b / 255.0 for a, b in zip(result[:4], row[:4], strict=True)] if multiplied else row[:4]
            if not multiplied and row[4] < 0.0 and row[3] < 255.0:  # something of what is below shows
                share = row[3] / 255.0
                color = [share * a + (1.0 - share) * b for a, b in zip(row[:3], result, strict=False)]
                color.append(max(result[3], row[3]))
                row = [*row[:4], *result[4:]]
            result = [*color, *(result[4:] if multiplied and row[4] < 0.0 else row[4:])]
        return tuple(result)

    def _entry_of(self, group: int, entry: int) -> "list[float]":
        row = self._groups[group][entry * _ROW : (entry + 1) * _ROW] if entry >= 0 else array("d")
        if len(row) != _ROW:
            raise ValueError
        return row.tolist()


def number(text: str | None) -> int:
    """The number that an attribute holds; -1 for none."""
    return int(text) if text is not None and text.isascii() and text.isdigit() and len(text) < 10 else -1


def split(faces: IntArray, painted: Painted) -> tuple[AnyArray, IntArray, ByteArray, FloatArray]:
    """One vertex for all of one look at one place: which they were (w,), faces, colours (w, 4), and places (w, 2)."""
    colors, places = painted.colors.reshape(-1, 4), painted.places.reshape(-1, 2)
    packed = colors.astype(np.int64) @ np.array([1 << 24, 1 << 16, 1 << 8, 1])
    vertices = faces.reshape(-1).astype(np.int64)
    keys = [vertices, packed]
    if (painted.pictures >= 0).any():
        drawn = np.repeat(painted.pictures >= 0, 3)
        keys += [np.where(drawn, np.rint(_STEPS * column).astype(np.int64), 0) for column in places.T]
    first, kind = distinct_rows(keys)
    return vertices[first], kind.reshape(-1, 3).astype(np.int32), np.ascontiguousarray(colors[first]), places[first]


def _color(text: str) -> tuple[float, float, float, float]:
    """``#RRGGBB`` or ``#RRGGBBAA``."""
    red, green, blue, *alpha = bytes.fromhex(text.strip()[1:])
    return red, green, blue, alpha[0] if alpha else 255
