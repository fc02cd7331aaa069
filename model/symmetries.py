"""What was found on a shape, in the unit frame."""

from dataclasses import dataclass, field
from typing import Literal

from model.types import FloatArray

Reason = Literal["not_symmetric", "duplicate", "not_continuous", "look_alike"]


@dataclass(frozen=True, slots=True, eq=False)
class FoundPlane:
    """``plane`` ``(4,)`` row ``(n, d)``, its SDE, and whether it stands for a family through a continuous axis."""

    plane: FloatArray
    error: float
    continuous: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class FoundAxis:
    """Unit ``direction`` ``(3,)``, a ``point`` ``(3,)``, ``order`` (None: continuous), the SDE of its smallest turn."""

    direction: FloatArray
    point: FloatArray
    order: int | None
    error: float


@dataclass(frozen=True, slots=True, eq=False)
class TurnedDown:
    """A candidate that is no symmetry: a ``plane`` ``(4,)``, or ``direction`` and ``point`` of an axis; SDE and reason.

    ``not_symmetric``: its error exceeds the threshold. ``duplicate``: closer than pi/6 to a better one (paper mode).
    ``not_continuous``: the predicted rotation holds, but not every 1 degree about the axis does (paper mode).
    ``look_alike``: it holds within the threshold, but so would others of a whole family: the shape is only round, thin
    or a lump there (full mode).
    """

    error: float
    reason: Reason
    plane: FloatArray | None = None
    direction: FloatArray | None = None
    point: FloatArray | None = None


@dataclass(slots=True, eq=False)
class Symmetries:
    """All planes and axes, the name of the group, what was rejected; ``judging_ms`` is time spent on the verdict."""

    planes: list[FoundPlane] = field(default_factory=list[FoundPlane])
    axes: list[FoundAxis] = field(default_factory=list[FoundAxis])
    point_group: str = "C1"
    rejected: list[TurnedDown] = field(default_factory=list[TurnedDown])
    judging_ms: float = 0.0
