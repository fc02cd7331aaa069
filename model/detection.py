"""Results in the input frame, as the library returns them and the service serialises them."""

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from model.mesh import Mesh
from model.transforms import reflection_homogeneous, rotation_homogeneous
from model.types import FloatArray
from model.validation import Reason


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
    """A candidate that validation turned down, in the input frame, and why.

    ``not_symmetric``: its error exceeds the threshold. ``duplicate``: closer than pi/6 to a better one.
    ``not_continuous``: the predicted rotation holds, but not every 1 degree about the axis does.
    """

    kind: Literal["plane", "axis"]
    symmetry_error: float
    reason: Reason
    normal: FloatArray | None = None
    offset: float | None = None
    direction: FloatArray | None = None
    point: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Detection:
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
        out), continuous ones as axis and a point on it. Reflections have no place there.
        """
        discrete = [
            rotation_homogeneous(axis.direction, axis.point, 2.0 * np.pi * k / axis.order).ravel().tolist()
            for axis in self.axes
            if axis.order is not None
            for k in range(1, axis.order)
        ]
        continuous = [
            {"axis": axis.direction.tolist(), "offset": axis.point.tolist()} for axis in self.axes if axis.continuous
        ]
        return {"symmetries_discrete": discrete, "symmetries_continuous": continuous}
