"""Surfaces of revolution, and the sphere: one axis, or three, stand for families without end."""

import numpy as np

from model.geometry.operations import Operations
from model.search.axis_order import ARBITRARY_ANGLES, SPHERE_DEVIATION, allowed_turns
from model.search.candidates import settle
from model.search.judgement import EXACT_ERROR, tangents
from model.search.shape import Shape
from model.symmetries import FoundAxis, FoundPlane, Symmetries
from model.types import FloatArray


def revolution(shape: Shape, direction: FloatArray, point: FloatArray) -> Symmetries:
    """A surface of revolution: the axis, what lies across it, and two planes through it for all of them."""
    across = settle(
        shape.surface,
        shape.points,
        shape.samples,
        Operations.reflections(np.append(direction, -direction @ shape.centre)),
        shape.max_error,
    )
    first, second = tangents(direction)
    has_plane = len(across.errors) > 0
    centre = point + direction * (direction @ (shape.centre - point))
    if has_plane:
        plane = across.operations.planes[0]
        centre = centre - direction * ((plane[:3] @ centre + plane[3]) / (plane[:3] @ direction))
    if has_plane and all(_round(shape, side, centre) for side in (first, second)):
        axes = [direction, first, second]
        name = "Kh"
    else:
        axes = [direction]
        name = "Dinfh" if has_plane else "Cinfv"
    through = [first, second, direction] if name == "Kh" else [first, second]
    planes = [np.append(normal, -normal @ centre) for normal in through]
    if name == "Dinfh":
        planes.append(across.operations.planes[0])
    errors, safe = shape.judge.errors(Operations.reflections(np.stack(planes)))
    result = Symmetries(point_group=name)
    for index, (plane, error) in enumerate(zip(planes, errors, strict=True)):
        if safe[index]:
            result.planes.append(FoundPlane(plane, float(error), continuous=index < len(through)))
        elif index == len(through):
            result.point_group = "Cinfv"
    turns = Operations.rotations(np.stack(axes), centre, float(ARBITRARY_ANGLES[0]))
    errors, safe = shape.judge.errors(turns)
    for axis, error, holds in zip(axes, errors, safe, strict=True):
        if holds:
            result.axes.append(FoundAxis(axis, centre, None, float(error)))
    return result


def _round(shape: Shape, direction: FloatArray, centre: FloatArray) -> bool:
    turns = allowed_turns(
        shape.surface,
        shape.samples[::2],
        direction,
        centre,
        limit=EXACT_ERROR,
        max_error=shape.max_error,
        deviation=SPHERE_DEVIATION,
    )
    return turns.order is None
