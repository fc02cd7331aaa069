"""How a group about an axis may be extended: by a higher order of it, by planes and half turns that go with it."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from model.geometry.operations import Operations
from model.geometry.transforms import rotation_matrix
from model.search.context import SearchContext
from model.search.deviation import SurfaceSamples
from model.search.hypothesis import Hypothesis
from model.search.lines import PARALLEL, common_point
from model.search.point_groups import ARBITRARY_ANGLES, axial_name, frame_of, point_group
from model.types import FloatArray

_AZIMUTHS, _BEST_AZIMUTHS, _AZIMUTH_STRIDE = 32, 3, 5
_CLOSER, _MANY_STRIDE = 12, 3
"""So many azimuths are compared on every so many-th of many samples where there is noise."""

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

    Args:
        context: the shape.
        group: with an axis, but neither of them.
    """
    order, across = group.group.principal_order, group.name.endswith("h")
    noisy = group.rms > context.settings.modelling_precision
    for symbol in ("v", ""):
        for side in _best_sides(context, group, mirrored=symbol == "v", noisy=noisy):
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


def turned_to_best(context: SearchContext, hypothesis: Hypothesis) -> Hypothesis:
    """A group turned about its axis to where planes through it explain the surface best.

    In noise it may have been built on any plane through the axis, and no fit gets it away from there.

    Args:
        context: the shape, nearly round about the axis; else the group stays as it is.
        hypothesis: with planes through its axis; else it stays as it is.
    """
    through = hypothesis.planes[np.abs(hypothesis.planes[:, :3] @ hypothesis.axis) < _PERPENDICULAR]
    arbitrary = Operations.rotations(hypothesis.axis, hypothesis.centre, ARBITRARY_ANGLES)
    if not len(through) or context.meter.measure(arbitrary, context.judging).rms.max() > context.limit:
        return hypothesis
    own = through[0, :3]
    facing = replace(hypothesis, frame=frame_of(hypothesis.axis, own))
    best = _best_sides(context, facing, mirrored=True, noisy=True)[0]
    angle = np.arctan2(np.cross(own, best) @ hypothesis.axis, own @ best)
    return replace(hypothesis, frame=hypothesis.frame @ rotation_matrix(hypothesis.axis, float(angle)).T)


def _best_sides(context: SearchContext, group: Hypothesis, *, mirrored: bool, noisy: bool) -> FloatArray:
    """Directions across the axis ``(k, 3)``, the best first: normals of planes if ``mirrored``, else of half turns.

    Both repeat with the period pi / n about an axis of order n. The first that is looked at is the group's first axis.
    """
    first, second = group.frame[0], group.frame[1]
    angles = np.pi / group.group.principal_order * np.arange(_AZIMUTHS) / _AZIMUTHS
    sides = np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second
    order = np.argsort(_errors(context, group, sides, context.samples.every(_AZIMUTH_STRIDE), mirrored), kind="stable")
    if noisy:  # on few samples it would choose
        order = np.unique(np.concatenate([[0], order[:_CLOSER]]))
        errors = _errors(context, group, sides[order], context.many.every(_MANY_STRIDE), mirrored)
        order = order[np.argsort(errors, kind="stable")]
    return sides[order[:_BEST_AZIMUTHS]]


def _errors(
    context: SearchContext, group: Hypothesis, sides: FloatArray, samples: SurfaceSamples, mirrored: bool
) -> FloatArray:
    """The truncated SDE of each: ``(k,)``."""
    if mirrored:
        kind = Operations.reflections(np.column_stack([sides, -sides @ group.centre]))
    else:
        kind = Operations.rotations(sides, group.centre, np.pi)
    deviations = context.meter.measure(kind, samples)
    telling = context.meter.telling(deviations)
    squared = np.where(telling, np.minimum(deviations.squared, context.settings.truncation**2), 0.0)
    return squared.sum(1) / np.maximum(telling.sum(1), 1)
