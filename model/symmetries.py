"""What was found on a shape, in the unit frame."""

from dataclasses import dataclass, field
from typing import Literal

from model.types import FloatArray

Reason = Literal["not_symmetric", "duplicate", "not_continuous"]
EvidenceKind = Literal["measured", "predicted"]
"""What an element or a level rests on: on the surface, on which it was refined and judged; or on the network, which
knows what such shapes usually look like, where the surface says too little."""


@dataclass(frozen=True, slots=True, eq=False)
class FoundPlane:
    """A reflection plane.

    ``plane`` ``(4,)``: row ``(n, d)``. ``error``: its SDE over the surface whose counterpart is not missing.
    ``continuous``: it stands for a family through a continuous axis. ``coverage``: share of the surface whose
    counterpart is there and fits. ``exact``: it holds everywhere up to what the file promises. ``max_distance``: the
    largest deviation seen. ``confidence``: probability that it is one of the intact shape; None if not judged.
    ``evidence``: what it rests on.
    """

    plane: FloatArray
    error: float
    continuous: bool = False
    coverage: float = 1.0
    exact: bool = False
    max_distance: float = 0.0
    confidence: float | None = None
    evidence: EvidenceKind = "measured"


@dataclass(frozen=True, slots=True, eq=False)
class FoundAxis:
    """A rotation axis: unit ``direction`` ``(3,)``, a ``point`` ``(3,)``, ``order`` (None: continuous).

    The other fields are those of `FoundPlane`, for the smallest rotation.
    """

    direction: FloatArray
    point: FloatArray
    order: int | None
    error: float
    coverage: float = 1.0
    exact: bool = False
    max_distance: float = 0.0
    confidence: float | None = None
    evidence: EvidenceKind = "measured"


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A candidate that is not part of the answer: a ``plane`` ``(4,)``, or ``direction`` and ``point`` of an axis.

    ``error``: its SDE. ``reason``: None if it holds within the threshold but belongs to no group. ``not_symmetric``:
    its error exceeds the threshold. ``duplicate``: closer than pi/6 to a better one (paper mode). ``not_continuous``:
    the predicted rotation holds, but not every 1 degree about the axis does (paper mode).
    """

    error: float
    reason: Reason | None
    plane: FloatArray | None = None
    direction: FloatArray | None = None
    point: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """A part of the surface that breaks a symmetry.

    ``centre`` ``(3,)`` and ``size`` (the diagonal of its box); ``deviation``: the largest there. ``present``: something
    is there that has no counterpart; else something is missing there that other places have.
    """

    centre: FloatArray
    size: float
    deviation: float
    present: bool


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """One group that holds, at one tolerance.

    ``point_group``: Schoenflies symbol. ``rms``: the largest RMS deviation of its operations; ``missing``: share of the
    surface whose counterpart lies beyond an open boundary. ``planes``, ``axes``: how many. ``exact``: it holds
    everywhere up to what the file promises; None if that was not tested. ``breaks``: where it does not. ``confidence``:
    probability that it is a group of the intact shape. ``evidence``: what it rests on.
    """

    point_group: str
    rms: float
    missing: float
    planes: int
    axes: int
    exact: bool | None = None
    breaks: tuple[Patch, ...] = ()
    confidence: float = 1.0
    evidence: EvidenceKind = "measured"


@dataclass(slots=True, eq=False)
class Symmetries:
    """All planes and axes of one group and its name, the ``levels`` it was ``chosen`` from, and the other candidates.

    ``similar`` hold within the threshold but belong to no group; ``rejected`` do not hold. ``cut_short``: not all that
    could be tried was.
    """

    planes: list[FoundPlane] = field(default_factory=list[FoundPlane])
    axes: list[FoundAxis] = field(default_factory=list[FoundAxis])
    point_group: str = "C1"
    levels: list[Level] = field(default_factory=list[Level])
    chosen: int | None = None
    similar: list[Candidate] = field(default_factory=list[Candidate])
    rejected: list[Candidate] = field(default_factory=list[Candidate])
    cut_short: bool = False
