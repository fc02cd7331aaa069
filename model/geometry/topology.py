"""Connectivity of a mesh: duplicate vertices, which edges are open, whether the surface is closed."""

import os

import numpy as np

from model._jit import jit, kernel_array
from model.types import AnyArray, BoolArray, FloatArray, IntArray

_HASH_SEED = int.from_bytes(os.urandom(7), "big")
"""What hash tables start from, so that nobody can make a file whose vertices or faces all collide. Results are the same
for every seed."""


def is_watertight(vertices: FloatArray, faces: IntArray) -> bool:
    """Whether every undirected edge belongs to exactly two faces once vertices at identical positions are merged.

    Faces of which corners coincide have no area and do not count. Works for any (v, 3) coordinates and (f, 3) faces.
    """
    faces = kernel_array(faces, np.int32)
    merged = duplicate_vertex_map(vertices)
    starts = np.zeros(len(merged) + 1, dtype=np.int64)
    ends = np.empty(3 * len(faces), dtype=np.int32)
    _sort_edges(merged, faces, starts, ends)
    return bool(_all_paired(starts, ends))


def open_edges(merged: IntArray, faces: IntArray) -> BoolArray:
    """Which edges belong to one face alone: ``(f, 3)``.

    ``merged`` ``(v,)`` tells vertices at one place (`duplicate_vertex_map`). Edge k of a face leads from corner k to
    the next. Faces of which corners coincide have no open edges.
    """
    faces = kernel_array(faces, np.int32)
    starts = np.zeros(len(merged) + 1, dtype=np.int64)
    ends = np.empty(3 * len(faces), dtype=np.int32)
    _sort_edges(merged, faces, starts, ends)
    result = np.zeros((len(faces), 3), dtype=np.bool_)
    _find_open(merged, faces, starts, ends, result)
    return result


def edge_neighbours(merged: IntArray, faces: IntArray) -> IntArray:
    """The face beyond each edge: ``(f, 3)``, -1 for none.

    ``merged`` ``(v,)`` tells vertices at one place (`duplicate_vertex_map`). Edge k of a face leads from corner k to
    the next. An edge of one face alone has no neighbour, nor has one of three.
    """
    merged, faces = kernel_array(merged, np.int32), kernel_array(faces, np.int32)
    size = 16
    while size < 6 * len(faces):
        size *= 2
    count = 3 * len(faces)
    table, partner = np.full(size, -1, dtype=np.int32), np.full(count, -1, dtype=np.int32)
    uses, group = np.zeros(count, dtype=np.int32), np.empty(count, dtype=np.int32)
    result = np.full((len(faces), 3), -1, dtype=np.int32)
    _pair_edges(merged, faces, table, _HASH_SEED, uses, partner, group, result)
    return result


@jit
def _pair_edges(
    merged: IntArray,
    faces: IntArray,
    table: IntArray,
    seed: int,
    uses: IntArray,
    partner: IntArray,
    group: IntArray,
    result: IntArray,
) -> None:
    """Find the two faces of each edge through a hash table; ``uses``, ``partner`` and ``group`` ``(3 f,)`` are scratch.

    Edge k of face i has the number 3 i + k; the first at a place stands for all there.
    """
    mask = np.int64(table.shape[0] - 1)
    for edge in range(group.shape[0]):
        face, corner = edge // 3, edge % 3
        a, b = merged[faces[face, corner]], merged[faces[face, (corner + 1) % 3]]
        low, high = min(a, b), max(a, b)
        key = (np.uint64(seed) ^ np.uint64(low)) * np.uint64(0xD6E8FEB86659FD93)
        key ^= key >> np.uint64(32)
        key = (key ^ np.uint64(high)) * np.uint64(0xD6E8FEB86659FD93)
        key ^= key >> np.uint64(32)
        slot = np.int64(key & np.uint64(mask))
        while True:
            other = table[slot]
            if other < 0:
                table[slot] = edge
                other = np.int32(edge)
                break
            c = merged[faces[other // 3, other % 3]]
            d = merged[faces[other // 3, (other % 3 + 1) % 3]]
            if min(c, d) == low and max(c, d) == high:
                break
            slot = (slot + np.int64(1)) & mask
        group[edge] = other
        uses[other] += 1
        if other != edge:
            partner[other] = edge
    for edge in range(group.shape[0]):
        face, corner = edge // 3, edge % 3
        if (
            group[edge] != edge
            or uses[edge] != 2
            or merged[faces[face, corner]] == merged[faces[face, (corner + 1) % 3]]
        ):
            continue
        other = partner[edge]
        result[face, corner] = other // 3
        result[other // 3, other % 3] = face


def duplicate_vertex_map(vertices: FloatArray) -> IntArray:
    """For every vertex ``(v, 3)`` the index of the first one with the same coordinates: ``(v,)``."""
    positions = kernel_array(vertices, np.float64) + 0.0  # makes -0.0 and 0.0 the same bits
    return _first_equal_rows(positions.view(np.int64))


def distinct_faces(merged: IntArray, faces: IntArray) -> BoolArray:
    """Which faces ``(f,)`` are the first with their three corners, in any order.

    ``merged`` ``(v,)`` tells vertices at one place (`duplicate_vertex_map`).
    """
    corners = np.sort(merged[faces], axis=1).astype(np.int64)
    return np.asarray(_first_equal_rows(corners) == np.arange(len(faces)))


def _first_equal_rows(rows: AnyArray) -> IntArray:
    """For every row ``(n, 3)`` int64 the index of the first one that is equal: ``(n,)``."""
    size = 16
    while size < 2 * len(rows):
        size *= 2
    first = np.empty(len(rows), dtype=np.int32)
    _merge(rows, np.full(size, -1, dtype=np.int32), _HASH_SEED, first)
    return first


@jit
def _merge(bits: AnyArray, table: IntArray, seed: int, merged: IntArray) -> None:
    """For every row the first one with the same numbers, through a hash table with linear probing."""
    mask = np.uint64(table.shape[0] - 1)
    for vertex in range(bits.shape[0]):
        key = np.uint64(seed)
        for axis in range(3):
            key = (key ^ np.uint64(bits[vertex, axis])) * np.uint64(0xD6E8FEB86659FD93)
            key ^= key >> np.uint64(32)
        slot = np.int64(key & mask)
        while True:
            other = table[slot]
            if other < 0:
                table[slot] = vertex
                merged[vertex] = vertex
                break
            if (
                bits[other, 0] == bits[vertex, 0]
                and bits[other, 1] == bits[vertex, 1]
                and bits[other, 2] == bits[vertex, 2]
            ):
                merged[vertex] = other
                break
            slot = (slot + np.int64(1)) & np.int64(mask)


@jit
def _sort_edges(merged: IntArray, faces: IntArray, starts: AnyArray, ends: IntArray) -> None:
    """Edges grouped by their lower vertex: those of vertex i lead to ``ends[starts[i]:starts[i + 1]]``."""
    for face in range(faces.shape[0]):
        for corner in range(3):
            a, b = merged[faces[face, corner]], merged[faces[face, (corner + 1) % 3]]
            c = merged[faces[face, (corner + 2) % 3]]
            if a != b and b != c and c != a:
                starts[min(a, b)] += 1
    total = 0
    for vertex in range(starts.shape[0]):
        total += starts[vertex]
        starts[vertex] = total  # the end of each group; filling from behind turns it into the start
    for face in range(faces.shape[0]):
        for corner in range(3):
            a, b = merged[faces[face, corner]], merged[faces[face, (corner + 1) % 3]]
            c = merged[faces[face, (corner + 2) % 3]]
            if a != b and b != c and c != a:
                low = min(a, b)
                starts[low] -= 1
                ends[starts[low]] = max(a, b)


@jit
def _all_paired(starts: AnyArray, ends: IntArray) -> bool:
    for vertex in range(starts.shape[0] - 1):
        group = ends[starts[vertex] : starts[vertex + 1]]
        if group.shape[0] % 2 == 1:
            return False
        _sort(group)
        for index in range(0, group.shape[0], 2):
            if group[index] != group[index + 1]:
                return False
            if index > 0 and group[index] == group[index - 1]:
                return False
    return True


@jit
def _find_open(merged: IntArray, faces: IntArray, starts: AnyArray, ends: IntArray, result: BoolArray) -> None:
    for vertex in range(starts.shape[0] - 1):
        _sort(ends[starts[vertex] : starts[vertex + 1]])
    for face in range(faces.shape[0]):
        for corner in range(3):
            a, b = merged[faces[face, corner]], merged[faces[face, (corner + 1) % 3]]
            c = merged[faces[face, (corner + 2) % 3]]
            if a == b or b == c or c == a:
                continue
            low, high = min(a, b), max(a, b)
            first, last = starts[low], starts[low + 1]
            while first < last:  # the first of the equal ones
                middle = (first + last) // 2
                if ends[middle] < high:
                    first = middle + 1
                else:
                    last = middle
            result[face, corner] = first + 1 == starts[low + 1] or ends[first + 1] != high


@jit
def _sort(values: IntArray) -> None:
    """Heap sort in place: no vertex is so popular that it would take quadratic time."""
    count = values.shape[0]
    for start in range(count // 2 - 1, -1, -1):
        _sift(values, start, count)
    for end in range(count - 1, 0, -1):
        values[0], values[end] = values[end], values[0]
        _sift(values, 0, end)


@jit
def _sift(values: IntArray, root: int, end: int) -> None:
    while 2 * root + 1 < end:
        child = 2 * root + 1
        if child + 1 < end and values[child] < values[child + 1]:
            child += 1
        if values[root] >= values[child]:
            return
        values[root], values[child] = values[child], values[root]
        root = child
