"""Colours of 3MF: base materials and colour groups, and which of them the corners of triangles have."""

from dataclasses import dataclass, field

import numpy as np

from model.meshes.colors import distinct_rows
from model.types import AnyArray, ByteArray, IntArray

GROUPS = ("basematerials", "colorgroup")
_ENTRIES = {"base": "displaycolor", "color": "color"}


@dataclass(slots=True)
class Palette:
    """The colours of one part of a package, by the number of their group."""

    groups: dict[int, list[tuple[int, int, int, int]]] = field(
        default_factory=dict[int, list[tuple[int, int, int, int]]]
    )
    _open: int = -1

    def begin(self, name: str, attributes: dict[str, str]) -> bool:
        """An element starts; whether it was one of a colour."""
        if name in GROUPS:
            self._open = number(attributes.get("id"))
            self.groups.setdefault(self._open, [])
            return False
        if name not in _ENTRIES or self._open not in self.groups:
            return False
        self.groups[self._open].append(_color(attributes.get(_ENTRIES[name], "")))
        return True

    def corners(self, paints: AnyArray) -> ByteArray:
        """Colours (f, 3, 4) of triangles by group and three entries of it (f, 4); white where there is none."""
        result = np.full((len(paints), 3, 4), 255, dtype=np.uint8)
        for group, entries in self.groups.items():
            if not entries:
                continue
            own = np.flatnonzero(paints[:, 0] == group)
            which = paints[own, 1:]
            which = np.where(which < 0, which[:, :1], which)  # one for all three
            found = (which >= 0) & (which < len(entries))
            table = np.array(entries, dtype=np.uint8)
            result[own] = np.where(found[..., None], table[np.clip(which, 0, len(entries) - 1)], 255)
        return result


def number(text: str | None) -> int:
    """The number that an attribute holds; -1 for none."""
    return int(text) if text is not None and text.isascii() and text.isdigit() and len(text) < 10 else -1


def split(faces: IntArray, corners: ByteArray) -> tuple[AnyArray, IntArray, ByteArray]:
    """One vertex for every colour of a vertex: which they were (w,), faces over them, and colours (w, 4)."""
    colors = corners.reshape(-1, 4)
    packed = colors.astype(np.int64) @ np.array([1 << 24, 1 << 16, 1 << 8, 1])
    vertices = faces.reshape(-1).astype(np.int64)
    first, kind = distinct_rows([vertices, packed])
    return vertices[first], kind.reshape(-1, 3).astype(np.int32), np.ascontiguousarray(colors[first])


def _color(text: str) -> tuple[int, int, int, int]:
    """``#RRGGBB`` or ``#RRGGBBAA``; white for what is no colour."""
    try:
        red, green, blue, *alpha = bytes.fromhex(text.strip()[1:])
    except ValueError:
        return 255, 255, 255, 255
    return red, green, blue, alpha[0] if alpha else 255
