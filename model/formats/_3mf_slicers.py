"""What slicers keep in a 3MF file beside the shape: modifiers, support blockers and enforcers, negative volumes.

PrusaSlicer and its kin name ranges of an object's triangles, Bambu Studio and OrcaSlicer components of an object;
Cura marks whole objects.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from model.types import BoolArray

CURA = "http://software.ultimaker.com/xml/cura/"
BRUSHED = frozenset({"paint_color", "mmu_segmentation"})
"""Attributes of triangles that slicers keep what is painted with a brush in, in a code of their own."""

_CURA_HELPERS = ("support_mesh", "anti_overhang_mesh", "infill_mesh", "cutting_mesh")

Role: TypeAlias = Literal["shape", "helper", "negative"]

_ROLES: dict[str, Role] = {
    "parametermodifier": "helper", "supportblocker": "helper", "supportenforcer": "helper",
    "modifier_part": "helper", "support_blocker": "helper", "support_enforcer": "helper",
    "negativevolume": "negative", "negative_part": "negative",
}  # fmt: skip


@dataclass(slots=True)
class _Volume:
    """A range of an object's triangles, both ends included."""

    first: int
    last: int
    role: Role = "shape"


@dataclass(slots=True)
class Roles:
    """Which triangles and components of which object of the main part are no part of the shape."""

    volumes: dict[str, list[_Volume]] = field(default_factory=dict[str, list[_Volume]])
    parts: dict[tuple[str, str], Role] = field(default_factory=dict[tuple[str, str], Role])

    def triangles(self, item: str, count: int) -> tuple[BoolArray, int, int]:
        """Which of an object's triangles belong to the shape (count,), and how many other volumes there are."""
        kept = np.ones(count, dtype=np.bool_)
        helpers = negative = 0
        for volume in self.volumes.get(item, ()):
            if volume.role != "shape":
                kept[max(volume.first, 0) : max(volume.last + 1, 0)] = False
                helpers += volume.role == "helper"
                negative += volume.role == "negative"
        return kept, helpers, negative

    def component(self, item: str, target: str) -> Role:
        """What a component of an object is there for."""
        return self.parts.get((item, target), "shape")

    @staticmethod
    def is_cura_helper(settings: dict[str, str]) -> bool:
        """Whether an object's settings make it something else than a shape."""
        return any(settings.get(name, "").strip().lower() == "true" for name in _CURA_HELPERS)


class SlicerReader:
    """Collects roles from the events of a slicer's settings."""

    def __init__(self, roles: Roles, count_node: Callable[[], None]) -> None:
        self._roles = roles
        self._count_node = count_node
        self._object = ""
        self._volume: _Volume | None = None

    def begin(self, name: str, attributes: dict[str, str]) -> None:
        """An element starts."""
        local = name.rpartition(" ")[2]
        if local == "object":
            self._object, self._volume = attributes.get("id", ""), None
        elif local == "volume" and "firstid" in attributes and "lastid" in attributes:
            self._count_node()
            self._volume = _Volume(int(attributes["firstid"]), int(attributes["lastid"]))
            self._roles.volumes.setdefault(self._object, []).append(self._volume)
        elif local == "metadata" and self._volume is not None and attributes.get("type") == "volume":
            key, value = attributes.get("key", ""), attributes.get("value", "").lower()
            if key == "volume_type":
                self._volume.role = _ROLES.get(value, "shape")
            elif key == "modifier" and value == "1":  # older versions
                self._volume.role = "helper"
        elif local == "part":
            self._count_node()
            role = _ROLES.get(attributes.get("subtype", ""), "shape")
            self._roles.parts[self._object, attributes.get("id", "")] = role
