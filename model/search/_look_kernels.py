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


@jit_allocating
def corners_of_faces(first: IntArray, faces: IntArray, chosen: IntArray, corners: IntArray) -> int:
    """Fill ``corners`` with the merged vertices of the ``chosen`` faces, each once, in the order met: how many."""
    seen = np.zeros(len(first), dtype=np.bool_)
    count = 0
    for i in range(len(chosen)):
        for k in range(3):
            corner = first[faces[chosen[i], k]]
            if not seen[corner]:
                seen[corner] = True
                corners[count] = corner
                count += 1
    return count


@jit
def ends_of_edges(first: IntArray, faces: IntArray, chosen: IntArray, ends: IntArray) -> None:
    """Fill ``ends`` ``(3 m, 2)`` with the merged vertices at the ends of the edges of the ``chosen`` faces ``(m,)``."""
    for i in range(len(chosen)):
        for k in range(3):
            ends[3 * i + k, 0] = first[faces[chosen[i], k]]
            ends[3 * i + k, 1] = first[faces[chosen[i], (k + 1) % 3]]


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
    vertices: FloatArray,
    ends: IntArray,
    chosen: IntArray,
    at_vertex: FloatArray,
    middles: FloatArray,
    least: FloatArray,
) -> None:
    """Fill ``middles`` ``(m, 3)`` of the ``chosen`` edges and ``least`` ``(m,)``, the smaller sagitta of their ends."""
    for i in range(len(chosen)):
        a, b = ends[chosen[i], 0], ends[chosen[i], 1]
        for axis in range(3):
            middles[i, axis] = (vertices[a, axis] + vertices[b, axis]) / 2.0
        least[i] = min(at_vertex[a], at_vertex[b])
