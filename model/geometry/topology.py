"""Which vertices and faces of a mesh are the same."""

import os
from typing import Any

import numpy as np

from model._jit import jit, jit_inlined, kernel_array
from model._lanes import bits_of
from model.types import AnyArray, BoolArray, FloatArray, IntArray

_HASH_SEED = int.from_bytes(os.urandom(7), "big")
"""What hash tables start from, so that nobody can make a file whose vertices or faces all collide. Results are the same
for every seed."""

_RECENT = 4096
"""Of a mesh written face by face, most corners are at places of the last few rows: these are looked up first."""


_TOGETHER = 256


def duplicate_vertex_map(vertices: FloatArray) -> IntArray:
    """For every vertex ``(v, 3)`` the index of the first one with the same coordinates: ``(v,)``."""
    positions = kernel_array(vertices, np.float64) + 0.0  # makes -0.0 and 0.0 the same bits
    return _first_equal_rows(positions.view(np.int64))


def welded(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """The same surface with one vertex at each place, in the order in which places come first; as it is if few repeat.

    Files that write every face with corners of its own come to a sixth of their vertices. Nothing that is computed from
    the faces changes by it.

    Args:
        vertices: ``(v, 3)`` finite coordinates.
        faces: ``(f, 3)`` int32.
    """
    if len(vertices) <= len(faces):  # a closed surface that shares its vertices has half as many as faces
        return vertices, faces
    places, numbers = _weld(kernel_array(vertices, np.float64))
    if len(places) == len(vertices):
        return vertices, faces
    result = np.empty_like(faces)
    _renumber(kernel_array(faces, np.int32), numbers, result)
    return places, result


@jit
def are_equal(vertices: FloatArray, first: IntArray) -> bool:
    """Whether every vertex ``(v, 3)`` is where the one is that ``first`` ``(v,)`` names."""
    for vertex in range(vertices.shape[0]):
        other = first[vertex]
        if other != vertex:
            for axis in range(3):
                if vertices[vertex, axis] != vertices[other, axis]:
                    return False
    return True


@jit
def connected_parts(faces: IntArray, parts: IntArray) -> None:
    """Fill ``parts`` ``(v,)``: vertices that faces ``(f, 3)`` connect get the same number, the index of one of them."""
    for vertex in range(parts.shape[0]):
        parts[vertex] = vertex
    for face in range(faces.shape[0]):
        first = _root(faces[face, 0], parts)
        for corner in range(1, 3):
            first = _join(first, _root(faces[face, corner], parts), parts)
    for vertex in range(parts.shape[0]):
        parts[vertex] = _root(vertex, parts)


@jit
def connect_places(faces: IntArray, merged: IntArray, parts: IntArray, used: BoolArray) -> None:
    """What `connected_parts` does, of places: ``merged`` ``(v,)`` names the first vertex at each.

    ``used`` ``(v,)``, all false, is set where a face has a corner.
    """
    for vertex in range(parts.shape[0]):
        parts[vertex] = vertex
    for face in range(faces.shape[0]):
        first = -1
        for corner in range(3):
            place = merged[faces[face, corner]]
            used[place] = True
            root = _root(int(place), parts)
            first = root if first < 0 else _join(first, root, parts)
    for vertex in range(parts.shape[0]):
        parts[vertex] = _root(vertex, parts)


@jit_inlined
def _join(first: int, other: int, parts: IntArray) -> int:
    """Join two parts by their roots; the root of both."""
    first, last = min(first, other), max(first, other)
    parts[last] = first
    return first


@jit
def _root(vertex: int, parts: IntArray) -> int:
    """Where the way from a vertex ends, which gets shorter by being gone."""
    while parts[vertex] != vertex:
        parts[vertex] = parts[parts[vertex]]
        vertex = parts[vertex]
    return vertex


def distinct_faces(merged: IntArray, faces: IntArray) -> BoolArray:
    """Which faces ``(f,)`` are the first with their three corners, in any order.

    ``merged`` ``(v,)`` tells vertices at one place (`duplicate_vertex_map`).
    """
    corners = np.sort(merged[faces], axis=1).astype(np.int64)
    return np.asarray(_first_equal_rows(corners) == np.arange(len(faces)))


def occurs_once(numbers: AnyArray) -> BoolArray:
    """Which of the numbers ``(n,)`` int64 are equal to no other: ``(n,)``."""
    first = _first_equal_rows(np.stack([numbers, np.zeros_like(numbers), np.zeros_like(numbers)], axis=1))
    return np.asarray(np.bincount(first, minlength=len(numbers))[first] == 1)


def _size(places: int) -> int:
    """Of a hash table that so many places leave half empty: a power of two."""
    size = 16
    while size < 2 * places:
        size *= 2
    return size


def _first_equal_rows(rows: AnyArray) -> IntArray:
    """For every row ``(n, 3)`` int64 the index of the first one that is equal: ``(n,)``."""
    first = np.empty(len(rows), dtype=np.int32)
    _merge(rows, np.full(_size(len(rows)), -1, dtype=np.int32), _HASH_SEED, first)
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


def _weld(vertices: FloatArray) -> tuple[FloatArray, IntArray]:
    """All places ``(p, 3)`` in the order in which they come first, and for every vertex the number of its place."""
    count, known, done = len(vertices), 0, 0
    numbers, recent = np.empty(count, dtype=np.int32), np.zeros(_RECENT, dtype=np.int32)
    places, state = np.empty((0, 3)), np.zeros(2, dtype=np.int64)
    scratch, room = np.empty((3, _TOGETHER), dtype=np.int64), count // 16 + 2 * _TOGETHER
    while done < count:
        room *= 2
        places, smaller = np.empty((room, 3)), places
        places[:known] = smaller[:known]
        if not known:
            places[0] = np.nan  # which no place is equal to
        _find_places(
            vertices, _HASH_SEED, places, np.full(_size(room), -1, dtype=np.int32), recent, numbers, scratch, state
        )
        done, known = state.tolist()
    return places[:known], numbers


@jit
def _find_places(
    vertices: FloatArray,
    seed: int,
    places: FloatArray,
    table: IntArray,
    recent: IntArray,
    numbers: IntArray,
    scratch: AnyArray,
    state: AnyArray,
) -> None:
    """Go on numbering places until there may be no room for more. ``state``: vertices done, places known.

    Some vertices at a time, ``scratch`` ``(3, n)``: the memory of the table, which is far away, is asked for all of
    those that are not at recent places before anything depends on what is there.
    """
    first, known, together = state[0], state[1], scratch.shape[1]
    mask, low = np.int64(table.shape[0] - 1), np.int64(recent.shape[0] - 1)
    keys, left, heads = scratch[0], scratch[1], scratch[2]
    for place in range(known):
        slot = _hash(places[place, 0], places[place, 1], places[place, 2], seed) & mask
        while table[slot] >= 0:
            slot = (slot + 1) & mask
        table[slot] = place
    while first < vertices.shape[0] and known + together <= places.shape[0]:
        end, missed = min(first + together, vertices.shape[0]), 0
        for vertex in range(first, end):
            x, y, z = vertices[vertex, 0], vertices[vertex, 1], vertices[vertex, 2]
            key = _hash(x, y, z, seed)
            place = recent[key & low]
            numbers[vertex] = place
            keys[missed], left[missed] = key, vertex
            missed += not ((places[place, 0] == x) & (places[place, 1] == y) & (places[place, 2] == z))
        for step in range(missed):
            heads[step] = table[keys[step] & mask]
        for step in range(missed):
            vertex, key, place = left[step], keys[step], heads[step]
            x, y, z = vertices[vertex, 0], vertices[vertex, 1], vertices[vertex, 2]
            slot = key & mask
            if place < 0:
                place = table[slot]
            while place >= 0 and not (places[place, 0] == x and places[place, 1] == y and places[place, 2] == z):
                slot = (slot + 1) & mask
                place = table[slot]
            if place < 0:
                place = known
                places[place, 0], places[place, 1], places[place, 2] = x, y, z
                table[slot] = place
                known += 1
            numbers[vertex] = recent[key & low] = place
        first = end
    state[0], state[1] = first, known


@jit_inlined
def _hash(x: float, y: float, z: float, seed: int) -> Any:
    """Of three coordinates, the same for 0 and -0."""
    key = np.uint64(seed)
    key = (key ^ np.uint64(bits_of(x + 0.0))) * np.uint64(0xD6E8FEB86659FD93)
    key ^= key >> np.uint64(32)
    key = (key ^ np.uint64(bits_of(y + 0.0))) * np.uint64(0xD6E8FEB86659FD93)
    key ^= key >> np.uint64(32)
    key = (key ^ np.uint64(bits_of(z + 0.0))) * np.uint64(0xD6E8FEB86659FD93)
    return np.int64(key ^ (key >> np.uint64(32)))


@jit
def _renumber(faces: IntArray, numbers: IntArray, result: IntArray) -> None:
    for face in range(faces.shape[0]):
        for corner in range(3):
            result[face, corner] = numbers[faces[face, corner]]
