"""Where `model.search.features` looks: corners, middles of faces and of edges, each once."""

import numpy as np

from model._jit import jit, jit_allocating
from model.types import BoolArray, FloatArray, IntArray

_SPREAD = (73_856_093, 19_349_663)
"""Primes by which the ends of an edge are spread over a table."""


@jit
def middles_of_faces(vertices: FloatArray, faces: IntArray, chosen: IntArray, middles: FloatArray) -> None:
    """Fill ``middles`` ``(m, 3)`` with the centroids of the ``chosen`` faces ``(m,)``."""
    for i in range(len(chosen)):
        a, b, c = faces[chosen[i], 0], faces[chosen[i], 1], faces[chosen[i], 2]
        for axis in range(3):
            middles[i, axis] = (vertices[a, axis] + vertices[b, axis] + vertices[c, axis]) / 3.0


@jit
def corners_of_faces(
    first: IntArray, faces: IntArray, chosen: IntArray, numbers: IntArray, corners: IntArray, rows: IntArray
) -> int:
    """Fill ``corners`` with the merged vertices of the ``chosen`` faces, each once, in the order met: how many.

    ``rows`` ``(m, 3)``: where those of each chosen face are in it. ``numbers`` ``(v,)``, all -1, is scratch.
    """
    count = 0
    for i in range(len(chosen)):
        for k in range(3):
            corner = first[faces[chosen[i], k]]
            if numbers[corner] < 0:
                numbers[corner] = count
                corners[count] = corner
                count += 1
            rows[i, k] = numbers[corner]
    return count


@jit
def each_once(rows: IntArray, seen: BoolArray, result: IntArray) -> int:
    """Fill ``result`` with the numbers in ``rows`` ``(m, 3)``, each once, in the order met: how many.

    ``seen``, all false, is scratch for as many numbers as there are.
    """
    count = 0
    for i in range(rows.shape[0]):
        for k in range(3):
            row = rows[i, k]
            if not seen[row]:
                seen[row] = True
                result[count] = row
                count += 1
    return count


@jit
def ends_of_edges(rows: IntArray, ends: IntArray) -> None:
    """Fill ``ends`` ``(3 m, 2)`` with the numbers of the vertices at the ends of the edges of faces ``(m, 3)``."""
    for i in range(rows.shape[0]):
        for k in range(3):
            ends[3 * i + k, 0] = rows[i, k]
            ends[3 * i + k, 1] = rows[i, (k + 1) % 3]


@jit_allocating
def different_edges(ends: IntArray, left_out: BoolArray, kept: IntArray) -> int:
    """Fill ``kept`` with the first of each edge by its ``ends`` ``(m, 2)``, unless it is ``left_out``: how many."""
    size = 16
    while size < 2 * len(ends):
        size *= 2
    table, mask = np.full(size, np.int32(-1), dtype=np.int32), size - 1
    count = 0
    for i in range(len(ends)):
        if left_out[i]:
            continue
        low, high = min(ends[i, 0], ends[i, 1]), max(ends[i, 0], ends[i, 1])
        place = ((np.int64(low) * _SPREAD[0]) ^ (np.int64(high) * _SPREAD[1])) & mask
        while table[place] >= 0:
            other = table[place]
            if min(ends[other, 0], ends[other, 1]) == low and max(ends[other, 0], ends[other, 1]) == high:
                break
            place = (place + 1) & mask
        if table[place] < 0:
            table[place] = i
            kept[count] = i
            count += 1
    return count


@jit
def middles_of_edges(
    vertices: FloatArray, corners: IntArray, ends: IntArray, chosen: IntArray, middles: FloatArray
) -> None:
    """Fill ``middles`` ``(m, 3)`` of the ``chosen`` edges, whose ``ends`` are numbers of ``corners``."""
    for i in range(len(chosen)):
        a, b = corners[ends[chosen[i], 0]], corners[ends[chosen[i], 1]]
        for axis in range(3):
            middles[i, axis] = (vertices[a, axis] + vertices[b, axis]) / 2.0
