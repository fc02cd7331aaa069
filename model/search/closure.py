"""Finite groups of symmetry operations as matrices: closed under products, listed as elements, named after Schoenflies.

Matrices are orthogonal ``(3, 3)``; the common fixed point is kept by the caller. Members found on a mesh are not exact,
so that two matrices count as the same operation when they differ by less than `SAME` radians.
"""

from typing import NamedTuple

import numpy as np

from model._jit import kernel_array
from model.search._closure_kernels import close
from model.types import BoolArray, FloatArray

SAME = float(np.deg2rad(1.2))
"""Two-fold axes of Dn are pi / n apart: enough up to n = 64."""

LARGEST = 64
"""The largest order of an axis told from round."""

_LARGEST_CUBIC = 120


class Elements(NamedTuple):
    """``normals`` ``(p, 3)`` of planes, ``directions`` ``(a, 3)`` of axes with their ``orders`` ``(a,)``."""

    normals: FloatArray
    directions: FloatArray
    orders: tuple[int, ...]


def closure(
    generators: FloatArray, largest: int = LARGEST, same: float = SAME, *, snap: bool = False
) -> FloatArray | None:
    """All products of the generators ``(k, 3, 3)``: ``(g, 3, 3)``, the identity first.

    Args:
        generators: what to close, exact or nearly so.
        largest: order of an axis.
        same: matrices within so many radians are one.
        snap: give products the angles that such orders have, if they are as near.

    Returns:
        the members; None if they never close, or only with an axis of a larger order.
    """
    room = np.empty((max(4 * largest, _LARGEST_CUBIC), 3, 3))  # Dnh has 4 n members
    count = close(kernel_array(generators, np.float64), same, largest if snap else 0, room)
    if count < 0:
        return None
    group = room[:count]
    smallest = np.trace(group[1:][np.linalg.det(group[1:]) > 0], axis1=1, axis2=2).max(initial=-1.0)
    return group if smallest < 1.0 + 2.0 * np.cos(2.0 * np.pi / (largest + 0.5)) else None


def contains(group: FloatArray, matrices: FloatArray) -> BoolArray:
    """Which of the matrices ``(k, 3, 3)`` are members of the group ``(g, 3, 3)``: ``(k,)``."""
    return _known(matrices, group, SAME)


def elements(group: FloatArray, tolerance: float = SAME) -> Elements:
    """The planes and axes of a group, each once. An axis' order is the largest n with rotation by 2 pi / n in it."""
    members = group[1:]
    if not len(members):
        return Elements(np.zeros((0, 3)), np.zeros((0, 3)), ())
    proper = np.linalg.det(members) > 0
    reflections = ~proper & (np.trace(members, axis1=1, axis2=2) > 2.0 * np.cos(tolerance) - 1.0)
    lines = _axes_of(members[proper])
    same = np.abs(lines @ lines.T) > np.cos(tolerance)
    first = ~np.tril(same, -1).any(1)
    turns = same[first].sum(1) + 1  # and the identity
    return Elements(_axes_of(-members[reflections]), lines[first], tuple(turns.tolist()))


def name(group: FloatArray, found: Elements, same: float = SAME) -> str:
    """The Schoenflies symbol in ASCII of a finite point group ``(g, 3, 3)`` and its elements, one of the design's."""
    planes, _, orders = found
    inverted = bool(_known(-np.eye(3)[None], group, same)[0])
    if sum(order > 2 for order in orders) > 1:
        return _cubic(orders, len(planes) > 0, inverted)
    if not orders:
        return "Cs" if len(planes) else "Ci" if inverted else "C1"
    improper = group[np.linalg.det(group) < 0]
    main, n = principal(group, found), max(orders)
    across = bool(len(planes)) and bool((np.abs(planes @ main) > _PARALLEL).any())
    along = bool(len(planes)) and bool((np.abs(planes @ main) < 1.0 - _PARALLEL).any())
    if len(orders) > 1:
        return f"D{n}h" if across else f"D{n}d" if along else f"D{n}"
    if across:
        return f"C{n}h"
    if along:
        return f"C{n}v"
    return f"S{2 * n}" if len(improper) else f"C{n}"


def principal(group: FloatArray, found: Elements) -> FloatArray:
    """The direction ``(3,)`` of the principal axis of an axial group ``(g, 3, 3)`` with its elements.

    Of three two-fold axes it is the one of the rotoreflection (D2d), of equal ones the first.
    """
    _, directions, orders = found
    if max(orders) == 2 and len(orders) == 3:
        improper = group[np.linalg.det(group) < 0]
        quarter = improper[np.abs(np.trace(improper, axis1=1, axis2=2) + 1.0) < 0.1]
        if len(quarter):
            return _axes_of(-quarter)[0]
    return directions[int(np.argmax(orders))]


_PARALLEL = 0.97


def _cubic(orders: tuple[int, ...], mirrored: bool, inverted: bool) -> str:
    if 5 in orders:
        return "Ih" if inverted else "I"
    if 4 in orders:
        return "Oh" if inverted else "O"
    return "Th" if inverted else "Td" if mirrored else "T"


def _known(matrices: FloatArray, others: FloatArray, same: float) -> BoolArray:
    return np.asarray(_same(matrices, others, same).any(1))


def _same(matrices: FloatArray, others: FloatArray, same: float) -> BoolArray:
    # tr(A^T B) is 1 + 2 cos of the angle between two proper operations, or two improper ones; less between the kinds.
    traces = matrices.reshape(-1, 9) @ others.reshape(-1, 9).T
    return np.greater(traces, 1.0 + 2.0 * np.cos(same))


def _axes_of(matrices: FloatArray) -> FloatArray:
    """The unit directions ``(k, 3)`` that rotations ``(k, 3, 3)`` leave where they are."""
    _, vectors = np.linalg.eigh((matrices + matrices.transpose(0, 2, 1)) / 2.0)
    return vectors[:, :, -1]
