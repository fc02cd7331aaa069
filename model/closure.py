"""Finite groups of symmetry operations as matrices: closed under products, listed as elements, named after Schoenflies.

Matrices are orthogonal ``(3, 3)``; the common fixed point is kept by the caller. Members found on a mesh are not exact,
so that two matrices count as the same operation when they differ by less than `SAME` radians.
"""

from typing import NamedTuple

import numpy as np

from model.types import BoolArray, FloatArray

SAME = float(np.deg2rad(1.2))
"""Two-fold axes of Dn are pi / n apart: enough up to n = 64."""

LARGEST = 4 * 64
"""The largest group built: Dnh with n = 64 has so many members. Products that never close end here."""


class Elements(NamedTuple):
    """``normals`` ``(p, 3)`` of planes, ``directions`` ``(a, 3)`` of axes with their ``orders`` ``(a,)``."""

    normals: FloatArray
    directions: FloatArray
    orders: tuple[int, ...]


def closure(generators: FloatArray) -> FloatArray | None:
    """All products of the generators ``(k, 3, 3)``: ``(g, 3, 3)``, the identity first. None if they never close."""
    group = np.eye(3)[None]
    fresh = group
    while len(fresh):
        products = np.einsum("aij,bjk->abik", generators, fresh).reshape(-1, 3, 3)
        found: list[FloatArray] = []
        for product in products[~_known(products, group)]:
            if not found or not _known(product[None], np.stack(found))[0]:
                found.append(_orthogonal(product))
        fresh = np.reshape(found, (-1, 3, 3))
        group = np.concatenate([group, fresh])
        if len(group) > LARGEST:
            return None
    return group


def contains(group: FloatArray, matrices: FloatArray) -> BoolArray:
    """Which of the matrices ``(k, 3, 3)`` are members of the group ``(g, 3, 3)``: ``(k,)``."""
    return _known(matrices, group)


def elements(group: FloatArray) -> Elements:
    """The planes and axes of a group, each once. An axis' order is the largest n with rotation by 2 pi / n in it."""
    normals: list[FloatArray] = []
    lines: list[FloatArray] = []
    turns: list[int] = []
    for matrix in group[1:]:
        proper = np.linalg.det(matrix) > 0
        if not proper:
            if np.trace(matrix) > 2.0 * np.cos(SAME) - 1.0:
                normals.append(_axis_of(-matrix))
            continue
        line = _axis_of(matrix)
        same = [index for index, other in enumerate(lines) if abs(other @ line) > np.cos(SAME)]
        if same:
            turns[same[0]] += 1
        else:
            lines.append(line)
            turns.append(2)  # the identity and this one
    return Elements(np.reshape(normals, (-1, 3)), np.reshape(lines, (-1, 3)), tuple(turns))


def name(group: FloatArray) -> str:
    """The Schoenflies symbol in ASCII of a finite point group ``(g, 3, 3)``, one of those in the design."""
    planes, directions, orders = elements(group)
    inverted = bool(contains(group, -np.eye(3)[None])[0])
    if sum(order > 2 for order in orders) > 1:
        return _cubic(orders, len(planes) > 0, inverted)
    if not orders:
        return "Cs" if len(planes) else "Ci" if inverted else "C1"
    # The principal axis; of three two-fold ones (D2d) the one the rotoreflection turns about.
    improper = [matrix for matrix in group if np.linalg.det(matrix) < 0]
    main = directions[int(np.argmax(orders))]
    n = max(orders)
    if n == 2 and len(orders) == 3:
        quarter = [_axis_of(-matrix) for matrix in improper if abs(np.trace(matrix) + 1.0) < 0.1]
        main = quarter[0] if quarter else main
    across = bool(len(planes)) and bool((np.abs(planes @ main) > _PARALLEL).any())
    along = bool(len(planes)) and bool((np.abs(planes @ main) < 1.0 - _PARALLEL).any())
    if len(orders) > 1:
        return f"D{n}h" if across else f"D{n}d" if along else f"D{n}"
    if across:
        return f"C{n}h"
    if along:
        return f"C{n}v"
    return f"S{2 * n}" if improper else f"C{n}"


_PARALLEL = 0.97


def _cubic(orders: tuple[int, ...], mirrored: bool, inverted: bool) -> str:
    if 5 in orders:
        return "Ih" if inverted else "I"
    if 4 in orders:
        return "Oh" if inverted else "O"
    return "Th" if inverted else "Td" if mirrored else "T"


def _known(matrices: FloatArray, others: FloatArray) -> BoolArray:
    # tr(A^T B) is 1 + 2 cos of the angle between two proper operations, or two improper ones; less between the kinds.
    traces = matrices.reshape(-1, 9) @ others.reshape(-1, 9).T
    return (traces > 1.0 + 2.0 * np.cos(SAME)).any(1)


def _orthogonal(matrix: FloatArray) -> FloatArray:
    left, _, right = np.linalg.svd(matrix)
    return left @ right


def _axis_of(matrix: FloatArray) -> FloatArray:
    """The unit direction that a rotation ``(3, 3)`` leaves where it is."""
    values, vectors = np.linalg.eigh((matrix + matrix.T) / 2.0)
    return vectors[:, int(np.argmax(values))]
