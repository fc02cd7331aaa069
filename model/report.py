"""From the unit frame to the caller's: what was found, as `Detection` states it.

Numbers that differ from 0, from 1 or from a coordinate axis by less than rounding become exactly that, and lists are
ordered by what means something, so that the answer does not depend on the processor it was computed on.
"""

import numpy as np

from model.detection import Axis, Detection, Level, Plane, Rejected, prediction_warning
from model.detection import Patch as InputPatch
from model.geometry.frames import UnitFrame
from model.geometry.transforms import canonical_sign
from model.meshes.colors import has_colors
from model.meshes.mesh import Mesh
from model.search.settings import DEFAULT
from model.symmetries import Candidate, FoundAxis, FoundPlane, Patch, Symmetries
from model.symmetries import Level as FoundLevel
from model.types import FloatArray

_ROUNDING = 1e-9
"""Rounding that all steps of a detection leave, unit frame: nothing smaller is told."""

_NOTHING = 1e-14
"""Part of the scale that the sum over a surface may be off by: a centroid so near to zero is there."""

_DECIMALS = 12
_MOST_ROUNDED = 0.01  # lest nothing be left of a direction where coordinates are coarse beside the shape
_DIGITS = 6
_PROBABILITY_DECIMALS = 2
_MUCH_MISSING, _JUST_OVER = 0.02, 4.0


def to_input(
    found: Symmetries,
    frame: UnitFrame,
    mesh: Mesh,
    resolution: float,
    max_error: float,
    timings_ms: dict[str, float],
    notes: tuple[str, ...] = (),
    watertight: bool | None = None,
) -> Detection:
    """What was found, in the frame of ``mesh``.

    Args:
        found: in the unit frame.
        frame: the mesh's unit frame.
        mesh: what was searched.
        resolution: of its coordinates, unit frame.
        max_error: the threshold it was searched with.
        timings_ms: of the steps.
        notes: what else there is to say, as sentences.
        watertight: whether the mesh is, if that is known.
    """
    report = _Report(frame, min(max(_ROUNDING, 4.0 * resolution), _MOST_ROUNDED))
    planes = sorted((report.plane(plane) for plane in found.planes), key=_plane_order)
    axes = sorted((report.axis(axis) for axis in found.axes), key=_axis_order)
    return Detection(
        planes=planes,
        axes=axes,
        point_group=found.point_group,
        center=np.where(np.abs(frame.center) > _NOTHING * frame.scale, frame.center, 0.0),
        scale=frame.scale,
        mesh=mesh,
        timings_ms=timings_ms,
        warnings=[
            *mesh.warnings,
            *notes,
            *_color_warning(found, mesh),
            *_warnings(found, max_error),
            *prediction_warning(planes),
        ],
        levels=report.levels(found),
        similar=[report.candidate(item) for item in sorted(found.similar, key=lambda item: item.error)],
        known_watertight=watertight,
        rejected=[report.candidate(item) for item in sorted(found.rejected, key=lambda item: item.error)],
    )


def inside_warning(bodies: int, whole: Symmetries, outside: Symmetries) -> tuple[str, ...]:
    """What to know about a shape with bodies inside it, which count as surface.

    Args:
        bodies: how many are inside.
        whole: what the shape has with them.
        outside: what it has without.
    """
    some = "One body lies" if bodies == 1 else f"{bodies} bodies lie"
    count = "counts" if bodies == 1 else "count"
    has = [(_is_round(found) + len(found.planes) + len(found.axes), _is_exact(found)) for found in (whole, outside)]
    if has[1] <= has[0]:
        return (f"{some} inside another one and {count} as surface like the rest.",)
    them = "it" if bodies == 1 else "them"
    exactly = " exactly" if _is_exact(outside) else ""
    roughly = " only roughly" if whole.point_group == outside.point_group else ""
    return (
        f"{some} inside another one. Without {them} the shape has {outside.point_group}{exactly}, with {them} "
        f"{whole.point_group}{roughly}.",
    )


def _is_exact(found: Symmetries) -> bool:
    """Whether all that was found is."""
    return all(element.exact for element in (*found.planes, *found.axes))


def _is_round(found: Symmetries) -> int:
    """More than any number of elements of a finite group where there is a continuous axis."""
    return 10_000 * any(axis.order is None for axis in found.axes)


def _is_measured(level: FoundLevel) -> bool:
    return level.evidence == "measured"


def _color_warning(found: Symmetries, mesh: Mesh) -> tuple[str, ...]:
    """What may break a symmetry of the shape for those who see it."""
    if not (found.planes or found.axes) or not has_colors(mesh):
        return ()
    return ("The file has colours or textures. They were not considered: these are symmetries of the shape.",)


def _warnings(found: Symmetries, max_error: float) -> list[str]:
    """What a reader should know about how the answer came about."""
    warnings: list[str] = []
    chosen = None if found.chosen is None else found.levels[found.chosen]
    if found.cut_short:
        warnings.append(
            "The search was cut short, because it would have taken too long: there may be more symmetries, or a larger "
            "group. A smaller max_error makes it shorter."
        )
    if chosen is not None and chosen.missing >= _MUCH_MISSING:
        warnings.append(
            f"The surface is open. For {100 * chosen.missing:.0f} % of it the counterpart was not seen; that counts as "
            "missing, not as different."
        )
    if chosen is None and found.levels:
        likeliest = max(found.levels, key=lambda level: level.confidence)
        warnings.append(
            f"{likeliest.point_group} holds within max_error, but is a symmetry of the intact shape with a probability "
            f"of {likeliest.confidence:.2f} only: it is listed under levels."
        )
    nearest = min((item.error for item in found.rejected), default=np.inf)
    if not found.levels and not found.planes and nearest <= _JUST_OVER * max_error:
        warnings.append(
            f"No symmetry holds within max_error. The best candidate has an error of {nearest:.2g}: it takes a larger "
            "max_error to accept it."
        )
    return warnings


def _geometric(vector: FloatArray) -> tuple[float, ...]:
    """A fixed order of directions: along x first, then y, then z."""
    return tuple((-np.round(vector, 6)).tolist())


def _plane_order(plane: Plane) -> tuple[object, ...]:
    return (not plane.exact, _doubt(plane), _unexplained(plane), _geometric(plane.normal))


def _axis_order(axis: Axis) -> tuple[object, ...]:
    order = 0 if axis.order is None else -axis.order
    worse = not axis.exact, _doubt(axis), _unexplained(axis)
    return (not axis.continuous, order, *worse, _geometric(axis.direction))


def _doubt(element: Plane | Axis) -> float:
    """In hundredths: finer differences of confidence are none."""
    return -round(element.confidence or 0.0, 2)


def _unexplained(element: Plane | Axis) -> float:
    """Deviation in the unit frame, and what is left over of the surface: a hole may hide what does not fit."""
    return float(np.sqrt(element.symmetry_error)) + DEFAULT.missing_cost * (1.0 - element.coverage)


class _Report:
    """Elements of the unit frame in the input frame; what is smaller than ``rounding`` (unit frame) counts as zero."""

    def __init__(self, frame: UnitFrame, rounding: float) -> None:
        self._frame = frame
        self._rounding = rounding
        self._offset_decimals = _DECIMALS - int(np.ceil(np.log10(frame.scale)))

    def plane(self, found: FoundPlane) -> Plane:
        normal, offset = self._plane(found.plane)
        center = self._frame.center
        return Plane(
            normal=normal,
            offset=offset,
            point=self._place(center - (normal @ center + offset) * normal),
            symmetry_error=self._error(found.error),
            rms_distance=self._frame.scale * self._error(found.error) ** 0.5,
            max_distance=self._length(found.max_distance),
            coverage=round(found.coverage, 4),
            confidence=_probability(found.confidence),
            exact=found.exact,
            continuous=found.continuous,
            evidence=found.evidence,
        )

    def axis(self, found: FoundAxis) -> Axis:
        direction = self._direction(found.direction)
        return Axis(
            direction=direction,
            point=self._on_line(direction, found.point),
            order=found.order,
            continuous=found.order is None,
            symmetry_error=self._error(found.error),
            rms_distance=self._frame.scale * self._error(found.error) ** 0.5,
            max_distance=self._length(found.max_distance),
            coverage=round(found.coverage, 4),
            confidence=_probability(found.confidence),
            exact=found.exact,
            evidence=found.evidence,
        )

    def candidate(self, item: Candidate) -> Rejected:
        error = self._error(item.error)
        if item.plane is not None:
            normal, offset = self._plane(item.plane)
            return Rejected("plane", error, item.reason, normal=normal, offset=offset)
        direction = self._direction(np.zeros(3) if item.direction is None else item.direction)
        point = self._on_line(direction, np.zeros(3) if item.point is None else item.point)
        return Rejected("axis", error, item.reason, direction=direction, point=point)

    def levels(self, found: Symmetries) -> list[Level]:
        following = [*found.levels[1:], None][: len(found.levels)]
        return [
            self._level(
                level, self._length(other.rms) if other and _is_measured(other) else None, index == found.chosen
            )
            for index, (level, other) in enumerate(zip(found.levels, following, strict=True))
        ]

    def _level(self, level: FoundLevel, end: float | None, chosen: bool) -> Level:
        return Level(
            point_group=level.point_group,
            planes=level.planes,
            axes=level.axes,
            rms_distance=self._length(level.rms),
            next_rms_distance=end,
            missing=round(level.missing, 4),
            exact=level.exact,
            chosen=chosen,
            confidence=round(level.confidence, _PROBABILITY_DECIMALS),
            breaks=[self._patch(patch) for patch in level.breaks],
            evidence=level.evidence,
        )

    def _patch(self, patch: Patch) -> InputPatch:
        center = self._place(self._frame.to_input(patch.centre))
        return InputPatch(center, self._length(patch.size), self._length(patch.deviation), patch.present)

    def _plane(self, plane: FloatArray) -> tuple[FloatArray, float]:
        normal = self._direction(plane[:3])
        sign = 1.0 if normal @ plane[:3] > 0 else -1.0
        distance = sign * plane[3]
        if abs(distance) < self._rounding:
            distance = 0.0
        offset = self._frame.plane_to_input(np.append(normal, distance))[3]
        if abs(offset) < self._rounding * self._frame.scale:
            offset = 0.0
        return normal, float(np.round(offset, self._offset_decimals)) + 0.0

    def _direction(self, vector: FloatArray) -> FloatArray:
        """A unit vector with its sign settled; along a coordinate axis, or across one, exactly if it is so nearly."""
        vector = np.where(np.abs(vector) < self._rounding, 0.0, vector)
        length = np.linalg.norm(vector)
        vector = vector / length if length > 0.0 else vector
        vector = np.round(vector, _DECIMALS)
        return vector * canonical_sign(vector) + 0.0  # no negative zeros

    def _on_line(self, direction: FloatArray, point: FloatArray) -> FloatArray:
        """The mesh's centre (the unit frame's origin) projected on the axis, in the input frame."""
        foot = point - direction * (direction @ point)
        foot = np.where(np.abs(foot) < self._rounding, 0.0, foot)
        return self._place(self._frame.to_input(foot))

    def _place(self, point: FloatArray) -> FloatArray:
        return np.round(point, self._offset_decimals) + 0.0

    def _error(self, error: float) -> float:
        """An SDE; below what rounding makes of an exact symmetry it is 0."""
        return 0.0 if error < self._rounding**2 else _rounded(error)

    def _length(self, length: float) -> float:
        """A length of the unit frame in input units."""
        return 0.0 if length < self._rounding else _rounded(self._frame.scale * length)


def _probability(value: float | None) -> float | None:
    return None if value is None else round(value, _PROBABILITY_DECIMALS)


def _rounded(value: float) -> float:
    """To as many digits as other samples would confirm, and more than order any list by chance."""
    return float(f"{value:.{_DIGITS}g}")
