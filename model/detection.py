"""Results in the input frame, as the library returns them and the service serialises them."""

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from model.geometry.transforms import reflection_homogeneous, rotation_homogeneous
from model.meshes.mesh import Mesh
from model.summary import SymmetrySummary
from model.symmetries import Reason
from model.types import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """A reflection plane ``normal.x + offset = 0`` in the input frame.

    ``point`` is the mesh's centre projected onto it, ``matrix`` ``(4, 4)`` the reflection for column vectors.
    ``symmetry_error`` is the SDE (unit frame, squared), ``rms_distance`` its root in input units. ``exact``: symmetric
    up to modelling precision, not merely within the threshold. ``continuous``: one of a family through a
    continuous axis.
    """

    normal: FloatArray
    offset: float
    point: FloatArray
    symmetry_error: float
    rms_distance: float
    exact: bool
    continuous: bool

    @property
    def matrix(self) -> FloatArray:
        """The reflection as ``(4, 4)``, acting on column vectors of the input frame."""
        return reflection_homogeneous(np.append(self.normal, self.offset))


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

    @property
    def matrix(self) -> FloatArray | None:
        """Rotation by 2 pi / order as ``(4, 4)``; None for a continuous axis."""
        if self.order is None:
            return None
        return rotation_homogeneous(self.direction, self.point, 2.0 * np.pi / self.order)


@dataclass(frozen=True, slots=True, eq=False)
class Rejected:
    """A candidate that was turned down, in the input frame; for the reasons see `model.symmetries.TurnedDown`."""

    kind: Literal["plane", "axis"]
    symmetry_error: float
    reason: Reason
    normal: FloatArray | None = None
    offset: float | None = None
    direction: FloatArray | None = None
    point: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Detection(SymmetrySummary):
    """Everything found on one mesh. Lists are sorted by error; ``unit = (input - center) / scale``."""

    planes: list[Plane]
    axes: list[Axis]
    point_group: str
    center: FloatArray
    scale: float
    mesh: Mesh
    timings_ms: dict[str, float]
    warnings: list[str] = field(default_factory=list[str])
    rejected: list[Rejected] = field(default_factory=list[Rejected])

    def bop(self) -> dict[str, list[Any]]:
        """The symmetries as an entry of a BOP `models_info.json`.

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
        return {"symmetries_discrete": discrete, "symmetries_continuous": continuous}

    def _perpendicular_half_turn(self) -> tuple[FloatArray, FloatArray]:
        """Direction and point of an axis that turns a surface of revolution of group Dinfh over."""
        along = next(axis for axis in self.axes if axis.continuous)
        across = [plane for plane in self.planes if plane.continuous]
        mirror = next((plane for plane in self.planes if abs(plane.normal @ along.direction) > 0.9), None)
        centre = along.point if mirror is None else mirror.point
        side = across[0].normal if across else np.cross(along.direction, np.roll(along.direction, 1))
        return side / np.linalg.norm(side), centre
