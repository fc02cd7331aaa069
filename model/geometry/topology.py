"""Which vertices and faces of a mesh are the same."""

import os

import numpy as np

from model._jit import jit, kernel_array
from model.types import AnyArray, BoolArray, FloatArray, IntArray

_HASH_SEED = int.from_bytes(os.urandom(7), "big")
"""What hash tables start from, so that nobody can make a file whose vertices or faces all collide. Results are the same
for every seed."""


def duplicate_vertex_map(vertices: FloatArray) -> IntArray:
    """For every vertex ``(v, 3)`` the index of the first one with the same coordinates: ``(v,)``."""
    positions = kernel_array(vertices, np.float64) + 0.0  # makes -0.0 and 0.0 the same bits
    return _first_equal_rows(positions.view(np.int64))


@jit
def connected_parts(faces: IntArray, parts: IntArray) -> None:
    """Fill ``parts`` ``(v,)``: vertices that faces ``(f, 3)`` connect get the same number, the index of one of them."""
    for vertex in range(parts.shape[0]):
        parts[vertex] = vertex
    for face in range(faces.shape[0]):
        first = _root(faces[face, 0], parts)
        for corner in range(1, 3):
            other = _root(faces[face, corner], parts)
            first, last = min(first, other), max(first, other)
            parts[last] = first
    for vertex in range(parts.shape[0]):
        parts[vertex] = _root(vertex, parts)


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
