"""Laying a symmetric mesh along the coordinate axes: its main plane on YZ, its main axis on Z."""

import numpy as np

from model.detection import Axis, Detection, Plane
from model.errors import NoPlaneError
from model.geometry.transforms import rotation_matrix
from model.types import FloatArray

_X, _Z = np.eye(3)[0], np.eye(3)[2]
_PARALLEL = 1e-3
"""Sine below which two directions count as parallel: the elements of a group meet at whole fractions of a turn."""


def alignment(detection: Detection) -> FloatArray:
    """The rotation and shift (4, 4), for column vectors, that lay a mesh by its symmetries.

    The axis of the highest order goes to Z, with its point of the centre in the origin; then a plane that contains it
    goes to YZ. Without axes the best plane goes to YZ by the smallest turn there is, so that what points up stays as
    far up as it can. Of equals the one is taken that needs the smaller turn. Where the axis stands across the only
    plane, the plane comes to lie on XY.

    Raises:
        NoPlaneError: there is no symmetry to lay it by.
    """
    planes, axes = detection.planes, detection.axes
    if not planes and not axes:
        errors = [candidate.symmetry_error for candidate in detection.rejected]
        nearest = f"; the best has an error of {min(errors):.2g}. Give a larger max_error" if errors else ""
        raise NoPlaneError(f"The mesh has no plane and no axis within the threshold to be laid by{nearest}.")
    if not axes:
        normal = _facing(planes[0].normal, _X)
        turn = _smallest(normal, _X)
    else:
        main = _main(axes)
        turn = _smallest(_facing(main.direction, _Z), _Z)
        along = [plane for plane in planes if abs(float(plane.normal @ main.direction)) < _PARALLEL]
        if along:
            normal = turn @ _nearest(along, turn).normal
            normal = _facing(normal, _X) * [1.0, 1.0, 0.0]
            turn = _smallest(normal / np.linalg.norm(normal), _X) @ turn
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    matrix[:3, 3] = -turn @ _fixed_point(detection)
    return matrix


def _main(axes: list[Axis]) -> Axis:
    """The axis of the highest order; of several the one nearest to Z."""
    highest = max(axis.order or 10**9 for axis in axes)
    equals = [axis for axis in axes if (axis.order or 10**9) == highest]
    return max(equals, key=lambda axis: round(abs(float(axis.direction @ _Z)), 6))


def _nearest(planes: list[Plane], turn: FloatArray) -> Plane:
    """The plane that needs the smallest turn to lie on YZ."""
    return max(planes, key=lambda plane: round(abs(float((turn @ plane.normal) @ _X)), 6))


def _fixed_point(detection: Detection) -> FloatArray:
    """The point that goes to the origin: the mesh's centre, moved onto the main plane or axis and what crosses it."""
    if detection.axes:
        main = _main(detection.axes)
        point = main.point
        for plane in detection.planes:
            if abs(float(plane.normal @ main.direction)) > 1.0 - _PARALLEL:
                point = point - (plane.normal @ point + plane.offset) / (plane.normal @ main.direction) * main.direction
        return point
    return detection.planes[0].point


def _facing(direction: FloatArray, towards: FloatArray) -> FloatArray:
    """A direction or its opposite, whichever is nearer to another."""
    return direction if float(direction @ towards) >= 0.0 else -direction


def _smallest(source: FloatArray, target: FloatArray) -> FloatArray:
    """The rotation (3, 3) that takes one unit vector to another by the smallest angle."""
    across = np.cross(source, target)
    sine, cosine = float(np.linalg.norm(across)), float(source @ target)
    if sine < 1e-15:
        return np.eye(3)  # the callers turn opposite ones around first
    return rotation_matrix(across / sine, float(np.arctan2(sine, cosine)))
