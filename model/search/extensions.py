"""How a group about an axis may be extended: by a higher order of it, by planes and half turns that go with it."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from model.geometry.operations import Operations
from model.geometry.transforms import rotation_matrix
from model.search.context import SearchContext
from model.search.harmonics import HARMONICS_STRIDE, harmonics
from model.search.hypothesis import Hypothesis
from model.search.lines import PARALLEL, common_point
from model.search.point_groups import ARBITRARY_ANGLES, axial_name, frame_of, point_group
from model.types import FloatArray

_AZIMUTHS, _BEST_AZIMUTHS = 32, 3
_AZIMUTH_STRIDE, _AZIMUTH_STRIDE_IN_NOISE = 5, 2
_PERPENDICULAR = float(np.sin(np.deg2rad(4.0)))


def with_axis(group: Hypothesis, direction: FloatArray, point: FloatArray, order: int) -> Hypothesis | None:
    """A group grown by an axis that all it holds goes with, as the principal one; None if something does not.

    Args:
        group: what is to grow.
        direction: of the axis, ``(3,)`` unit.
        point: on the axis ``(3,)``.
        order: of the axis.
    """
    normals, axes = group.group.normals @ group.frame, group.directions
    orders = np.array(group.group.orders, dtype=np.int64)
    to_normals, to_axes = np.abs(normals @ direction), np.abs(axes @ direction)
    through, across = to_normals < _PERPENDICULAR, to_normals > PARALLEL
    half, along = (to_axes < _PERPENDICULAR) & (orders == 2), to_axes > PARALLEL
    if not ((through | across).all() and (half | along).all()):
        return None
    inverted = group.name == "Ci" or bool(
        len(group.matrices) and (np.trace(group.matrices, axis1=1, axis2=2) < -2.9).any()
    )
    has_across = bool(across.any()) or (inverted and order % 2 == 0)
    name = axial_name(
        order,
        through=bool(through.any()),
        across=has_across,
        half_turns=bool(half.any()),
        rotoreflection=inverted and order % 2 == 1,
    )
    side = direction
    if half.any():
        side = axes[half][0]
    elif through.any():
        normal = normals[through][0]
        side = normal if name.endswith("v") else np.cross(normal, direction)
        if name.endswith("d"):  # half turns lie between the planes
            angle = np.pi / (2.0 * order)
            side = np.cos(angle) * side + np.sin(angle) * np.cross(direction, side)
    centre = common_point(
        Operations.joined([group.generators, Operations.rotations(direction, point, 2.0 * np.pi / order)]),
        group.centre,
    )
    return Hypothesis(point_group(name), frame_of(direction, side), centre)


def azimuths(context: SearchContext, group: Hypothesis) -> Iterator[Hypothesis]:
    """A group with planes through its principal axis, or half turns across it: where these are is not known.

    Both repeat with the period pi / n about an axis of order n: of many azimuths within one the best are tried.

    Args:
        context: the shape.
        group: with an axis, but neither of them.
    """
    precise = group.rms <= context.settings.modelling_precision
    samples = context.samples.every(_AZIMUTH_STRIDE if precise else _AZIMUTH_STRIDE_IN_NOISE)
    order = group.group.principal_order
    first, second = group.frame[0], group.frame[1]
    angles = np.pi / order * np.arange(_AZIMUTHS) / _AZIMUTHS
    sides = np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second
    planes = Operations.reflections(np.column_stack([sides, -sides @ group.centre]))
    turns = Operations.rotations(sides, group.centre, np.pi)
    across = group.name.endswith("h")
    shown = [] if precise else _azimuths_shown(context, group)
    for kind, symbol in ((planes, "v"), (turns, "")):
        squared = context.meter.measure(kind, samples).squared
        errors = np.minimum(squared, context.settings.truncation**2).mean(1)
        best = list(sides[np.argsort(errors, kind="stable")[:_BEST_AZIMUTHS]])
        for side in shown + best if symbol == "v" else best:
            if symbol == "v" and not across:
                name = f"C{order}v"
                if group.name[0] == "S":
                    name, angle = f"D{order}d", np.pi / (2.0 * order) + np.pi / 2.0
                    side = np.cos(angle) * side + np.sin(angle) * np.cross(group.axis, side)
            elif across:
                name = f"D{order}h"
                side = np.cross(side, group.axis) if symbol == "v" else side
            else:
                name = f"D{order}d" if group.name[0] == "S" else f"D{order}"
            yield Hypothesis(point_group(name), frame_of(group.axis, side), group.centre)


def _azimuths_shown(context: SearchContext, group: Hypothesis) -> list[FloatArray]:
    """Normals ``(3,)`` of planes through the axis of a nearly round surface, from the phase of its harmonics.

    In noise a plane anywhere else is hardly worse.
    """
    order = group.group.principal_order
    arbitrary = Operations.rotations(group.axis, group.centre, ARBITRARY_ANGLES)
    if context.meter.measure(arbitrary, context.judging).rms.max() > context.limit:
        return []
    shown = harmonics(context.meter, context.many.every(HARMONICS_STRIDE), group.axis, group.centre, context.settings)
    return [np.cross(group.axis, along) for along in shown.mirrored_at(order)]


def turned_as_shown(context: SearchContext, hypothesis: Hypothesis) -> Hypothesis:
    """A group turned about its axis until its planes stand where the harmonics of a nearly round surface show them.

    In noise it may have been built on any plane through the axis, and no fit gets it away from there. It stays as it is
    where that explains more samples better.
    """
    through = hypothesis.planes[np.abs(hypothesis.planes[:, :3] @ hypothesis.axis) < _PERPENDICULAR]
    shown = _azimuths_shown(context, hypothesis) if len(through) else []
    if not shown:
        return hypothesis
    normals = np.array([through[0, :3], *shown])
    planes = Operations.reflections(np.column_stack([normals, -normals @ hypothesis.centre]))
    deviations = context.meter.measure(planes, context.many)
    squared = np.minimum(deviations.squared, context.settings.truncation**2)
    telling = context.meter.telling(deviations)
    best = normals[np.argmin(np.where(telling, squared, 0.0).sum(1) / np.maximum(telling.sum(1), 1))]
    angle = np.arctan2(np.cross(normals[0], best) @ hypothesis.axis, normals[0] @ best)
    return replace(hypothesis, frame=hypothesis.frame @ rotation_matrix(hypothesis.axis, float(angle)).T)
