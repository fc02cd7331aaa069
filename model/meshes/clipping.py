"""Cutting triangles along a line where a quantity changes its sign: a plane, or a distance."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from model.types import BoolArray, FloatArray, IntArray

Crossing = Callable[[FloatArray, FloatArray], FloatArray]
"""From points ``(k, 3)`` inside and ``(k, 3)`` outside, the points ``(k, 3)`` between them where the border is."""


@dataclass(frozen=True, slots=True, eq=False)
class Clipped:
    """The part of a mesh inside a border.

    Attributes:
        vertices: ``(v, 3)``: those of the whole mesh, and behind them the ones on the border.
        faces: ``(f, 3)``, the uncut ones first.
        is_border: ``(v,)`` whether a vertex was made where an edge crosses the border.
    """

    vertices: FloatArray
    faces: IntArray
    is_border: BoolArray


def clip(vertices: FloatArray, faces: IntArray, inside: BoolArray, crossing: Crossing) -> Clipped:
    """Keep the part of the triangles that belongs to the vertices marked in ``inside`` ``(v,)``.

    A triangle with corners of both kinds is cut at the points that ``crossing`` finds on its edges; an edge's point is
    found once, so that neighbours stay joined.
    """
    count = inside[faces].sum(axis=1)
    kept = faces[count == 3]
    cut = faces[(count == 1) | (count == 2)]
    # Turn the corners so that the one that is alone on its side comes first.
    alone = np.argmax(inside[cut] == (inside[cut].sum(axis=1) == 1)[:, None], axis=1)
    cut = np.take_along_axis(cut, (alone[:, None] + np.arange(3)) % 3, axis=1)
    one, other = np.repeat(cut[:, 0], 2).astype(np.int64), cut[:, 1:].reshape(-1)
    keys, index = np.unique(np.minimum(one, other) * len(vertices) + np.maximum(one, other), return_inverse=True)
    unique = np.stack([keys // len(vertices), keys % len(vertices)], axis=1)
    swap = ~inside[unique[:, 0]]
    unique[swap] = unique[swap][:, ::-1]
    points = crossing(vertices[unique[:, 0]], vertices[unique[:, 1]]) if len(unique) else np.empty((0, 3))
    first, second = (len(vertices) + index.reshape(-1, 2)).T
    a, b, c = cut.T
    tip = inside[a] if len(cut) else np.empty(0, dtype=np.bool_)
    pieces = [
        kept,
        np.stack([a, first, second], axis=1)[tip],
        np.stack([first, b, c], axis=1)[~tip],
        np.stack([first, c, second], axis=1)[~tip],
    ]
    grown = np.concatenate([vertices, points])
    is_border = np.arange(len(grown)) >= len(vertices)
    return Clipped(grown, np.concatenate(pieces).astype(np.int32), is_border)


def remove_unreferenced_vertices(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray, IntArray]:
    """The vertices that faces use, the faces over them, and which vertices these were."""
    is_used = np.zeros(len(vertices), dtype=np.bool_)
    is_used[faces] = True
    used = np.flatnonzero(is_used).astype(np.int32)
    local = np.empty(len(vertices), dtype=np.int32)
    local[used] = np.arange(len(used), dtype=np.int32)
    return vertices[used], local[faces], used


def nondegenerate_mask(faces: IntArray) -> BoolArray:
    """Which faces ``(f, 3)`` have three different corners: ``(f,)``."""
    a, b, c = faces.T
    return (a != b) & (b != c) & (c != a)
