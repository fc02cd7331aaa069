"""From the unit frame to the caller's: what was found, as `Detection` states it."""

import numpy as np

from model.detection import Axis, Detection, Plane, Rejected
from model.geometry.frames import UnitFrame
from model.geometry.transforms import canonical_sign
from model.meshes.mesh import Mesh
from model.search.judgement import EXACT_ERROR
from model.symmetries import FoundAxis, FoundPlane, Symmetries, TurnedDown
from model.types import FloatArray


def to_input(found: Symmetries, frame: UnitFrame, mesh: Mesh, timings_ms: dict[str, float]) -> Detection:
    """Planes, axes and rejections in the frame of ``mesh``, each list sorted by error."""
    return Detection(
        planes=[_plane(plane, frame) for plane in sorted(found.planes, key=lambda item: item.error)],
        axes=[_axis(axis, frame) for axis in sorted(found.axes, key=lambda item: item.error)],
        point_group=found.point_group,
        center=frame.center,
        scale=frame.scale,
        mesh=mesh,
        timings_ms=timings_ms,
        rejected=[_rejected(item, frame) for item in sorted(found.rejected, key=lambda item: item.error)],
    )


def _signed(vector: FloatArray) -> FloatArray:
    return vector * canonical_sign(vector) + 0.0  # no negative zeros


def _plane(found: FoundPlane, frame: UnitFrame) -> Plane:
    plane = _signed(frame.plane_to_input(found.plane))
    normal, offset = plane[:3], float(plane[3])
    return Plane(
        normal=normal,
        offset=offset,
        point=frame.center - (normal @ frame.center + offset) * normal,
        symmetry_error=found.error,
        rms_distance=frame.scale * found.error**0.5,
        exact=found.error < EXACT_ERROR,
        continuous=found.continuous,
    )


def _axis(found: FoundAxis, frame: UnitFrame) -> Axis:
    return Axis(
        direction=_signed(found.direction),
        point=_on_line(found.direction, found.point, frame),
        order=found.order,
        continuous=found.order is None,
        symmetry_error=found.error,
        rms_distance=frame.scale * found.error**0.5,
        exact=found.error < EXACT_ERROR,
    )


def _on_line(direction: FloatArray, point: FloatArray, frame: UnitFrame) -> FloatArray:
    """The mesh's centre (the unit frame's origin) projected on the axis, in the input frame."""
    return frame.to_input(point - direction * (direction @ point))


def _rejected(item: TurnedDown, frame: UnitFrame) -> Rejected:
    if item.plane is not None:
        plane = _signed(frame.plane_to_input(item.plane))
        return Rejected("plane", item.error, item.reason, normal=plane[:3], offset=float(plane[3]))
    direction = np.zeros(3) if item.direction is None else item.direction
    point = np.zeros(3) if item.point is None else item.point
    return Rejected(
        "axis", item.error, item.reason, direction=_signed(direction), point=_on_line(direction, point, frame)
    )
