"""Results in the input frame, as the library returns them and the service serialises them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from model.geometry.diameter import diameter
from model.geometry.transforms import reflection_homogeneous, rotation_homogeneous
from model.meshes.mesh import Mesh
from model.summary import SymmetrySummary
from model.symmetries import EvidenceKind, Reason
from model.types import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """A reflection plane ``normal.x + offset = 0`` in the input frame.

    ``point`` is the mesh's centre projected onto it, ``matrix`` ``(4, 4)`` the reflection for column vectors.
    ``symmetry_error`` is the SDE (unit frame, squared) over the surface whose counterpart is not missing,
    ``rms_distance`` its root in input units, ``max_distance`` the largest deviation seen, ``coverage`` the share of the
    surface whose counterpart is there and fits. ``exact``: symmetric everywhere, up to what the file itself promises.
    ``continuous``: one of a family through a continuous axis. ``confidence``: the probability that it is a symmetry of
    the intact shape, None in paper mode. ``evidence``: ``measured`` on the surface, or ``predicted`` by the network,
    where the surface that is there says too little; then it is never exact.
    """

    normal: FloatArray
    offset: float
    point: FloatArray
    symmetry_error: float
    rms_distance: float
    exact: bool
    continuous: bool
    max_distance: float = 0.0
    coverage: float = 1.0
    confidence: float | None = None
    evidence: EvidenceKind = "measured"

    @property
    def matrix(self) -> FloatArray:
        """The reflection as ``(4, 4)``, acting on column vectors of the input frame."""
        return reflection_homogeneous(np.append(self.normal, self.offset))


def prediction_warning(planes: Sequence[Plane]) -> tuple[str, ...]:
    """What to know about an answer whose plane is predicted; nothing where all are measured."""
    predicted = [plane for plane in planes if plane.evidence == "predicted"]
    return tuple(
        "The plane is predicted, not measured: the surface that is there bears it out too little. By what the network "
        f"says it is a symmetry of the intact shape with a probability of {plane.confidence or 0.0:.2f}."
        for plane in predicted[:1]
    )


@dataclass(frozen=True, slots=True, eq=False)
class Axis:
    """A rotation axis in the input frame. ``order`` is None where every angle is a symmetry (``continuous``)."""

    direction: FloatArray
    point: FloatArray
    order: int | None
    continuous: bool
    symmetry_error: float
    rms_distance: float
    exact: bool
    max_distance: float = 0.0
    coverage: float = 1.0
    confidence: float | None = None
    evidence: EvidenceKind = "measured"

    @property
    def matrix(self) -> FloatArray | None:
        """Rotation by 2 pi / order as ``(4, 4)``; None for a continuous axis."""
        if self.order is None:
            return None
        return rotation_homogeneous(self.direction, self.point, 2.0 * np.pi / self.order)


@dataclass(frozen=True, slots=True, eq=False)
class Rejected:
    """A candidate that is not in the answer, in the input frame; for its reason see `model.symmetries.Candidate`."""

    kind: Literal["plane", "axis"]
    symmetry_error: float
    reason: Reason | None
    normal: FloatArray | None = None
    offset: float | None = None
    direction: FloatArray | None = None
    point: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """A part of the surface that breaks a symmetry, input frame: its ``center``, ``size`` and largest deviation.

    ``present``: something is there that has no counterpart; else something is missing there.
    """

    center: FloatArray
    size: float
    max_distance: float
    present: bool


@dataclass(frozen=True, slots=True, eq=False)
class Level:
    """One symmetry group that holds.

    It needs a tolerance (RMS deviation) of ``rms_distance``, the next larger one of ``next_rms_distance``, input units;
    None above the last. ``missing``: share of the surface whose counterpart lies beyond an open boundary. ``exact`` is
    None where it was not tested. ``breaks``: where it does not hold, of the ``chosen`` level. ``confidence``: the
    probability that it is a group of the intact shape. ``evidence``: ``measured``, or ``predicted`` as of a `Plane`.
    """

    point_group: str
    planes: int
    axes: int
    rms_distance: float
    next_rms_distance: float | None
    missing: float
    exact: bool | None
    chosen: bool
    confidence: float
    breaks: list[Patch] = field(default_factory=list[Patch])
    evidence: EvidenceKind = "measured"


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Detection(SymmetrySummary):
    """Everything found on one mesh; ``unit = (input - center) / scale``.

    Planes and axes are those of ``point_group``. What is exact comes first, then by error, of axes the higher order
    before. ``similar`` hold within the threshold but belong to no group. ``known_watertight``: what `watertight` says,
    where it was seen on the way.
    """

    planes: list[Plane]
    axes: list[Axis]
    point_group: str
    center: FloatArray
    scale: float
    mesh: Mesh
    timings_ms: dict[str, float]
    warnings: list[str] = field(default_factory=list[str])
    rejected: list[Rejected] = field(default_factory=list[Rejected])
    levels: list[Level] = field(default_factory=list[Level])
    similar: list[Rejected] = field(default_factory=list[Rejected])
    known_watertight: bool | None = None

    @property
    def watertight(self) -> bool:
        """`Mesh.watertight` of the mesh."""
        return self.mesh.watertight if self.known_watertight is None else self.known_watertight

    def bop(self) -> dict[str, Any]:
        """Diameter and symmetries as in an entry of a BOP `models_info.json`.

        BOP knows proper rotations only: discrete ones as flat row-major 4 x 4 matrices (the identity left
        out), continuous ones as axis and a point on it. Reflections have no place there. A surface of revolution that
        has a plane across its axis can also be turned over: one half turn stands for all of them.
        """
        discrete = [
            rotation_homogeneous(axis.direction, axis.point, 2.0 * np.pi * k / axis.order).ravel().tolist()
            for axis in self.axes
            if axis.order is not None
            for k in range(1, axis.order)
        ]
        if self.point_group == "Dinfh":
            across, centre = self._perpendicular_half_turn()
            discrete.append(rotation_homogeneous(across, centre, np.pi).ravel().tolist())
        continuous = [
            {"axis": axis.direction.tolist(), "offset": axis.point.tolist()} for axis in self.axes if axis.continuous
        ]
        longest = diameter(self.mesh.vertices[np.unique(self.mesh.faces)])
        return {"diameter": longest, "symmetries_discrete": discrete, "symmetries_continuous": continuous}

    def _perpendicular_half_turn(self) -> tuple[FloatArray, FloatArray]:
        """Direction and point of an axis that turns a surface of revolution of group Dinfh over."""
        along = next(axis for axis in self.axes if axis.continuous)
        across = [plane for plane in self.planes if plane.continuous]
        mirror = next((plane for plane in self.planes if abs(plane.normal @ along.direction) > 0.9), None)
        centre = along.point if mirror is None else mirror.point
        side = across[0].normal if across else np.cross(along.direction, np.roll(along.direction, 1))
        return side / np.linalg.norm(side), centre
