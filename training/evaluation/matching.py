"""Which of a shape's true planes and axes a detector has found, and which of its answers are true.

Everything is in the unit frame of the intact shape. A true plane is found when a returned plane is within `ANGLE` of it
and its offset, measured at the shape's centre, within `DISTANCE`; or when a returned continuous axis lies in it. A true
axis is found when a returned axis has its direction and passes its point; where every angle is a symmetry the returned
one must say so. Whether the order is right too is told apart.

A continuous axis with a plane across stands for the two-fold axes in that plane too. It has planes without end, a
sphere has axes without end; the truth lists two or three of them that no answer needs to repeat. The k-th of these is
found when k members of the family are returned, or what stands for all of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from model.types import BoolArray, FloatArray
from training.oracle.truth import CLEAR_ERROR, Truth

ANGLE = 1.0
"""Degrees."""

DISTANCE = 0.01
"""Unit frame: a hundredth of the bounding sphere's diameter."""


class FoundAxis(NamedTuple):
    """Unit ``direction`` and ``point`` ``(3,)``; ``order`` None where every angle is said to be a symmetry."""

    direction: FloatArray
    point: FloatArray
    order: int | None


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What a detector returned: ``planes`` ``(k, 4)``, rows (n, d), and ``axes``, both best first."""

    planes: FloatArray
    axes: Sequence[FoundAxis] = ()


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """Truth against answer.

    Attributes:
        planes: (p,) which true planes were found.
        angles: (p,) degrees between each found plane and what it was found by; NaN where it was not.
        axes: (a,) which true axes were found.
        orders: (a,) which of them with the right order.
        true_planes: (k,) which returned planes are true.
        true_axes: (j,) which returned axes are true; the order is not asked for.
    """

    planes: BoolArray
    angles: FloatArray
    axes: BoolArray
    orders: BoolArray
    true_planes: BoolArray
    true_axes: BoolArray


def clear(truth: Truth) -> Truth:
    """The truth reduced to its clear planes and axes."""
    kept = truth.plane_errors < CLEAR_ERROR
    return replace(
        truth,
        planes=truth.planes[kept],
        plane_errors=truth.plane_errors[kept],
        plane_continuous=truth.plane_continuous[kept],
        axes=truth.clear_axes(),
    )


def match(truth: Truth, found: Found) -> Matches:
    """Compare an answer with the truth, both in the unit frame of the intact shape."""
    axes = [FoundAxis(axis.direction, axis.point, axis.order) for axis in truth.axes]
    endless = [axis for axis in axes if axis.order is None]
    returned_endless = [axis for axis in found.axes if axis.order is None]
    centre, returned_centre = _sphere(endless), _sphere(returned_endless)

    plane_angles = np.full(len(truth.planes), np.nan)
    family_seen = 0
    for row, plane in enumerate(truth.planes):
        angle = min((_between_planes(plane, other) for other in found.planes), default=np.inf)
        angle = min([angle, *(_axis_in_plane(axis, plane) for axis in returned_endless)])
        if returned_centre is not None and _reaches(returned_centre, plane):
            angle = 0.0
        if not np.isfinite(angle) and truth.plane_continuous[row]:
            members = _family_angles(endless, centre, found, returned_endless)
            angle = members[family_seen] if family_seen < len(members) else np.inf
        family_seen += bool(truth.plane_continuous[row])
        if np.isfinite(angle):
            plane_angles[row] = angle

    axis_found = np.zeros(len(axes), dtype=np.bool_)
    axis_order = np.zeros(len(axes), dtype=np.bool_)
    for row, axis in enumerate(axes):
        same = [other for other in found.axes if _same_line(axis, other)]
        if returned_centre is not None and _line_distance(returned_centre, axis) <= DISTANCE:
            same += returned_endless[:1]
        axis_order[row] = any(other.order == axis.order for other in same)
        axis_found[row] = axis_order[row] if axis.order is None else bool(same)
        implied = any(_turns_over(axis, other, found.planes) for other in returned_endless)
        axis_found[row], axis_order[row] = axis_found[row] or implied, axis_order[row] or implied
    if centre is not None:  # every line through the centre is an axis: count them
        through = sum(_line_distance(centre, axis) <= DISTANCE for axis in returned_endless)
        rows = [row for row, axis in enumerate(axes) if axis.order is None]
        for seen, row in enumerate(rows):
            axis_found[row] = axis_order[row] = axis_found[row] or seen < through

    true_planes = [
        any(np.isfinite(_between_planes(plane, other)) for other in truth.planes)
        or any(np.isfinite(_axis_in_plane(axis, plane)) for axis in endless)
        or (centre is not None and _reaches(centre, plane))
        for plane in found.planes
    ]
    true_axes = [
        any(_same_line(axis, other) for other in axes)
        or any(_turns_over(axis, other, truth.planes) for other in endless)
        or (centre is not None and _line_distance(centre, axis) <= DISTANCE)
        for axis in found.axes
    ]
    return Matches(
        planes=np.isfinite(plane_angles),
        angles=plane_angles,
        axes=axis_found,
        orders=axis_order,
        true_planes=np.array(true_planes, dtype=np.bool_),
        true_axes=np.array(true_axes, dtype=np.bool_),
    )


def matched_once(truth: Truth, found: Found, true_planes: BoolArray) -> list[bool]:
    """Which of the returned planes, in their order, match a true one that no earlier one has matched.

    As the SHREC 2023 protocol counts: a plane returned twice is right once. Of the planes of a continuous family, which
    no list holds all of, each counts.

    Args:
        truth: the true planes.
        found: the returned ones, the most confident first.
        true_planes: (k,) of `Matches`.
    """
    left = list(truth.planes)
    sequence: list[bool] = []
    for plane, true in zip(found.planes, true_planes, strict=True):
        row = next((row for row, other in enumerate(left) if same_plane(plane, other)), None)
        if row is not None:
            left.pop(row)
        family = bool(true) and not any(same_plane(plane, other) for other in truth.planes)
        sequence.append(row is not None or family)
    return sequence


def same_plane(first: FloatArray, second: FloatArray) -> bool:
    """Whether two planes (n, d) are within `ANGLE` and `DISTANCE`."""
    return bool(np.isfinite(_between_planes(first, second)))


def _between_planes(first: FloatArray, second: FloatArray) -> float:
    """Degrees between two planes; infinity where they are not within the tolerances."""
    cosine = float(first[:3] @ second[:3])
    if abs(first[3] - (1.0 if cosine >= 0 else -1.0) * second[3]) > DISTANCE:
        return np.inf
    angle = angle_between(first[:3], second[:3])
    return angle if angle <= ANGLE else np.inf


def _axis_in_plane(axis: FoundAxis, plane: FloatArray) -> float:
    """Degrees by which an axis leaves a plane; infinity where it does not lie in it to the tolerances."""
    foot = axis.point - (axis.point @ axis.direction) * axis.direction  # the point nearest to the shape's centre
    if not _reaches(foot, plane):
        return np.inf
    angle = float(np.degrees(np.arcsin(min(1.0, abs(axis.direction @ plane[:3])))))
    return angle if angle <= ANGLE else np.inf


def _family_angles(
    endless: Sequence[FoundAxis], centre: FloatArray | None, found: Found, returned_endless: Sequence[FoundAxis]
) -> list[float]:
    """Degrees by which the returned members of the continuous families leave them, best first."""
    if centre is not None:
        through = sum(_reaches(centre, plane) for plane in found.planes)
        lines = any(_line_distance(centre, axis) <= DISTANCE for axis in returned_endless)
        return [0.0] * (3 if lines else through)
    angles = (_axis_in_plane(axis, plane) for axis in endless for plane in found.planes)
    members = sorted(angle for angle in angles if np.isfinite(angle))
    pairs = ((axis, other) for axis in endless for other in returned_endless)
    whole = [angle_between(axis.direction, other.direction) for axis, other in pairs if _same_line(axis, other)]
    return members + 2 * whole


def _sphere(endless: Sequence[FoundAxis]) -> FloatArray | None:
    """The centre where two different continuous axes meet; None where there are none."""
    for axis in endless[1:]:
        if angle_between(axis.direction, endless[0].direction) > ANGLE:
            # The point of the first that is nearest to the second.
            normal = np.cross(axis.direction, np.cross(axis.direction, endless[0].direction))
            along = (axis.point - endless[0].point) @ normal / (endless[0].direction @ normal)
            meeting = endless[0].point + along * endless[0].direction
            return meeting if _line_distance(meeting, axis) <= DISTANCE else None
    return None


def _same_line(truth: FoundAxis, found: FoundAxis) -> bool:
    close = angle_between(truth.direction, found.direction) <= ANGLE
    return close and _line_distance(truth.point, found) <= DISTANCE


def _turns_over(axis: FoundAxis, endless: FoundAxis, planes: FloatArray) -> bool:
    """Whether a two-fold axis crosses a continuous one at a right angle, in a plane that mirrors its two ends."""
    upright = abs(axis.direction @ endless.direction) <= np.sin(np.deg2rad(ANGLE))
    gap = abs((axis.point - endless.point) @ np.cross(axis.direction, endless.direction))
    middle = any(
        angle_between(plane[:3], endless.direction) <= ANGLE and np.isfinite(_axis_in_plane(axis, plane))
        for plane in planes
    )
    return axis.order == 2 and upright and bool(gap <= DISTANCE) and middle


def _line_distance(point: FloatArray, axis: FoundAxis) -> float:
    return float(np.linalg.norm(np.cross(point - axis.point, axis.direction)))


def _reaches(point: FloatArray, plane: FloatArray) -> bool:
    return bool(abs(plane[:3] @ point + plane[3]) <= DISTANCE)


def angle_between(first: FloatArray, second: FloatArray) -> float:
    """Degrees between two lines ``(3,)``; exact to rounding for small ones, as an arc cosine is not."""
    return float(np.degrees(np.arctan2(np.linalg.norm(np.cross(first, second)), abs(first @ second))))


def nearest_clear_plane(truth: Truth, plane: FloatArray) -> FloatArray | None:
    """The clear plane closest to ``plane`` in the measure of `ground_truth_error`, sign aligned with it: ``(4,)``.

    Where a continuous axis stands for all planes through it (and a sphere's centre for all through that), the closest
    member of the family counts: which of them the truth lists is chance. None where the truth has no clear plane.
    """
    endless = [FoundAxis(axis.direction, axis.point, None) for axis in truth.clear_axes() if axis.order is None]
    listed = truth.clear_planes()
    centre = _sphere(endless)
    members = [*listed]
    # A lone continuous axis has planes through it only if the truth lists any: a mirror-less helix has none.
    if truth.plane_continuous[truth.plane_errors < CLEAR_ERROR].any():
        if centre is not None:
            members.append(np.append(plane[:3], -plane[:3] @ centre))
        for axis in endless:
            across = plane[:3] - (plane[:3] @ axis.direction) * axis.direction
            length = float(np.linalg.norm(across))
            if length > 1e-6:
                members.append(np.append(across / length, -across @ axis.point / length))
    if not members:
        return None
    aligned = [member if member[:3] @ plane[:3] >= 0 else -member for member in members]
    return min(aligned, key=lambda member: float(np.square(member - plane).sum()))


def ground_truth_error(truth: Truth, plane: FloatArray) -> float | None:
    """GTE (design: definitions) of a plane (n, d) against the clear planes of the truth; None where there are none."""
    nearest = nearest_clear_plane(truth, plane)
    return None if nearest is None else float(np.square(nearest - plane).sum())


def clear_planes_found(truth: Truth, planes: FloatArray, angle: float, distance: float) -> int:
    """How many of the clear planes some row of ``planes`` ``(k, 4)`` meets within ``angle`` degrees and ``distance``.

    Two planes of a continuous family are listed; the k-th of them is found when k rows belong to the family.
    """
    kept = truth.plane_errors < CLEAR_ERROR
    family = truth.plane_continuous[kept]
    listed = truth.planes[kept]

    def meets(plane: FloatArray, other: FloatArray) -> bool:
        sign = 1.0 if plane[:3] @ other[:3] >= 0 else -1.0
        return abs(plane[3] - sign * other[3]) <= distance and angle_between(plane[:3], other[:3]) <= angle

    found = sum(any(meets(plane, other) for other in planes) for plane in listed[~family])
    if family.any():
        lone = replace(
            truth, planes=listed[family], plane_errors=np.zeros(int(family.sum())), plane_continuous=family[family]
        )
        nearest = [nearest_clear_plane(lone, plane) for plane in planes]
        members = sum(meets(plane, other) for plane, other in zip(planes, nearest, strict=True) if other is not None)
        found += min(int(family.sum()), members)
    return int(found)


def clear_axes_found(truth: Truth, axes: Sequence[FoundAxis], angle: float, distance: float) -> int:
    """How many of the clear axes some one of ``axes`` meets within ``angle`` degrees and ``distance`` of its point."""
    return sum(
        any(
            angle_between(axis.direction, other.direction) <= angle and _line_distance(axis.point, other) <= distance
            for other in axes
        )
        for axis in truth.clear_axes()
    )
