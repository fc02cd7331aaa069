"""The finite point groups as matrices, and the planes and axes they hold.

Conventions: the principal axis is z. ``Cs`` mirrors x. ``Cnv`` has a mirror through the x axis (normal y),
``Dn`` a two-fold axis along x, ``Dnd`` the same with its mirrors half-way between. The cubic and icosahedral
groups have two-fold axes along x, y, z and a three-fold axis along (1, 1, 1). Everything passes through the
origin.
"""

import re
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from model.geometry.transforms import rotation_matrix
from model.types import FloatArray

_SAME = 1e-6  # two unit vectors or matrices closer than this are the same element; the nearest differ by over 0.1
_CYCLIC = re.compile(r"(C|D|S)([1-9]\d*)(v|h|d)?")


class Elements(NamedTuple):
    """Mirror planes by unit normals ``planes`` (p, 3), rotation axes by unit directions ``axes`` (a, 3)."""

    planes: FloatArray
    axes: FloatArray
    orders: tuple[int, ...]


def rotation(axis: FloatArray | tuple[float, float, float], angle: float) -> FloatArray:
    """Return the (3, 3) rotation about ``axis`` (any length) by ``angle`` in radians."""
    direction = np.asarray(axis, dtype=np.float64)
    return rotation_matrix(direction / np.linalg.norm(direction), angle)


def canonical_sign(vector: FloatArray) -> FloatArray:
    """Return ``vector`` or its opposite: the first component that is not (nearly) zero is positive."""
    first = vector[np.argmax(np.abs(vector) > 1e-9)]
    return -vector if first < 0 else vector


@lru_cache(maxsize=256)
def group_matrices(name: str) -> FloatArray:
    """Return every element of a finite point group as orthogonal matrices.

    Args:
        name: a Schoenflies symbol in ASCII: ``C1 Cs Ci Cn Cnv Cnh Dn Dnd Dnh S2n T Td Th O Oh I Ih``.

    Returns:
        (g, 3, 3) float64, read-only, the identity first; determinants are 1 or -1.

    Raises:
        ValueError: the name is no finite point group (``Cinfv``, ``Dinfh`` and ``Kh`` are continuous).
    """
    elements = _closure(_generators(name))
    elements.setflags(write=False)
    return elements


def group_elements(name: str) -> Elements:
    """Return the mirror planes and rotation axes of a finite point group, each once.

    The order of an axis is the largest n for which the rotation by 2π/n is in the group. Improper axes and
    the centre of inversion are not listed: neither is a plane or a rotation.
    """
    planes: list[FloatArray] = []
    axes: list[FloatArray] = []
    orders: list[int] = []
    for matrix in group_matrices(name)[1:]:
        if np.linalg.det(matrix) < 0:
            if abs(np.trace(matrix) - 1.0) < _SAME:  # I - 2 n nᵀ
                planes.append(_line((np.eye(3) - matrix) / 2.0))
            continue
        direction = _rotation_axis(matrix)
        known = next((i for i, axis in enumerate(axes) if np.abs(axis - direction).max() < _SAME), None)
        if known is None:
            axes.append(direction)
            orders.append(2)  # the identity and this one
        else:
            orders[known] += 1
    return Elements(np.array(planes).reshape(-1, 3), np.array(axes).reshape(-1, 3), tuple(orders))


def _generators(name: str) -> list[FloatArray]:
    inversion, mirror_z = -np.eye(3), np.diag([1.0, 1.0, -1.0])
    half_x, half_z = np.diag([1.0, -1.0, -1.0]), np.diag([-1.0, -1.0, 1.0])
    third = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # about (1, 1, 1)
    swap = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    fifth = rotation((0.0, 1.0, (1.0 + np.sqrt(5.0)) / 2.0), 2.0 * np.pi / 5.0)
    named = {
        "C1": [],
        "Cs": [np.diag([-1.0, 1.0, 1.0])],
        "Ci": [inversion],
        "T": [half_z, third],
        "Td": [half_z, third, swap],
        "Th": [half_z, third, inversion],
        "O": [quarter, third],
        "Oh": [quarter, third, inversion],
        "I": [half_z, third, fifth],
        "Ih": [half_z, third, fifth, inversion],
    }
    if name in named:
        return named[name]
    match = _CYCLIC.fullmatch(name)
    if match is None:
        raise ValueError(f"{name!r} is not a finite point group")
    kind, n, suffix = match[1], int(match[2]), match[3]
    principal = rotation((0.0, 0.0, 1.0), 2.0 * np.pi / n)
    if kind == "S" and n % 2 == 0 and suffix is None:
        return [principal @ mirror_z]
    if kind == "C" and n > 1 and suffix != "d":
        extra = {None: [], "v": [np.diag([1.0, -1.0, 1.0])], "h": [mirror_z]}
        return [principal, *extra[suffix]]
    if kind == "D" and n > 1 and suffix != "v":
        extra = {None: [], "h": [mirror_z], "d": [rotation((0.0, 0.0, 1.0), np.pi / n) @ mirror_z]}
        return [principal, half_x, *extra[suffix]]
    raise ValueError(f"{name!r} is not a finite point group")


def _closure(generators: list[FloatArray]) -> FloatArray:
    group = np.eye(3)[None]
    fresh = group
    while len(fresh):
        found: list[FloatArray] = []
        for product in (generator @ element for generator in generators for element in fresh):
            known = np.concatenate([group, np.reshape(found, (-1, 3, 3))])
            if np.abs(known - product).max(axis=(1, 2)).min() > _SAME:
                found.append(product)
        fresh = np.reshape(found, (-1, 3, 3))
        group = np.concatenate([group, fresh])
    return group


def _rotation_axis(matrix: FloatArray) -> FloatArray:
    twice_sine = np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]])
    length = float(np.linalg.norm(twice_sine))
    if length > _SAME:
        return canonical_sign(twice_sine / length)
    return _line((matrix + np.eye(3)) / 2.0)  # a rotation by π: 2 u uᵀ - I


def _line(projector: FloatArray) -> FloatArray:
    """Return the unit vector u, canonical sign, of the rank-one matrix u uᵀ."""
    column = projector[:, int(np.argmax(np.diagonal(projector)))]
    return canonical_sign(column / np.linalg.norm(column))
