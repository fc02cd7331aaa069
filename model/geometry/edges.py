"""The edges of a mesh, and the faces that meet in each."""

import numpy as np

from model._jit import jit, kernel_array
from model.geometry.topology import duplicate_vertex_map, welded
from model.types import AnyArray, BoolArray, FloatArray, IntArray

_INSERTED = 24
"""Groups up to this are sorted by insertion."""

_LOOKED_AT = 16
"""So many faces of one edge are compared with a face that is looked for: a mesh that has more is no surface."""


class EdgeTable:
    """All edges of a mesh, grouped by their lower vertex.

    Edge k of a face leads from corner k to the next. Faces of which corners coincide have no area, and no edges.

    Args:
        merged: for every vertex the first one at its place (`duplicate_vertex_map`), ``(v,)``.
        faces: ``(f, 3)``.
    """

    def __init__(self, merged: IntArray, faces: IntArray) -> None:
        self._merged, self._faces = kernel_array(merged, np.int32), kernel_array(faces, np.int32)
        self._starts = np.zeros(len(merged) + 1, dtype=np.int64)
        self._ends, self._numbers = (np.empty(3 * len(faces), dtype=np.int32) for _ in range(2))
        single, crowded = _group(self._merged, self._faces, self._starts, self._ends, self._numbers)
        self.has_open = single > 0
        """Whether any edge belongs to one face alone."""
        self.all_paired = not single and not crowded
        """Whether every edge belongs to two faces: the surface is closed."""

    @property
    def open(self) -> BoolArray:
        """Which edges belong to one face alone: ``(f, 3)``."""
        result = np.zeros((len(self._faces), 3), dtype=np.bool_)
        if self.has_open:
            _find_open(self._starts, self._ends, self._numbers, result)
        return result

    @property
    def neighbours(self) -> IntArray:
        """The face beyond each edge: ``(f, 3)``, -1 where there is none, or more than one."""
        result = np.full((len(self._faces), 3), -1, dtype=np.int32)
        _find_neighbours(self._starts, self._ends, self._numbers, result)
        return result

    def neighbours_of(self, some: IntArray) -> IntArray:
        """Those of some of the faces ``(m,)``: ``(m, 3)``."""
        result = np.full((len(some), 3), -1, dtype=np.int32)
        some = kernel_array(some, np.int32)
        _look_up_neighbours(some, self._merged, self._faces, self._starts, self._ends, self._numbers, result)
        return result

    def are_edges(self, pairs: IntArray) -> BoolArray:
        """Which pairs of vertices ``(m, 2)``, merged ones, -1 for none, are the ends of an edge: ``(m,)``."""
        result = np.empty(len(pairs), dtype=np.bool_)
        _find_edges(kernel_array(pairs, np.int32), self._starts, self._ends, result)
        return result

    def faces_at(self, triples: IntArray) -> IntArray:
        """The faces at the edges between each two of three vertices ``(m, 3)``, merged ones, -1 for none: ``(m, 6)``.

        Two an edge at most, -1 where there are none.
        """
        result = np.full((len(triples), 6), -1, dtype=np.int32)
        _find_faces_at(kernel_array(triples, np.int32), self._starts, self._ends, self._numbers, result)
        return result

    def are_faces(self, triples: IntArray) -> BoolArray:
        """Which triples of vertices ``(m, 3)``, merged ones, -1 for none, are the corners of a face: ``(m,)``."""
        result = np.empty(len(triples), dtype=np.bool_)
        _find_faces(
            kernel_array(triples, np.int32),
            self._merged,
            self._faces,
            self._starts,
            self._ends,
            self._numbers,
            result,
        )
        return result


def is_watertight(vertices: FloatArray, faces: IntArray) -> bool:
    """Whether every undirected edge belongs to exactly two faces once vertices at identical positions are merged.

    Faces of which corners coincide have no area and do not count. Works for any (v, 3) coordinates and (f, 3) faces.
    """
    places, numbers = welded(vertices, faces)
    if len(places) <= len(faces):  # where there were more, places are known already
        return EdgeTable(duplicate_vertex_map(places), numbers).all_paired
    return EdgeTable(np.arange(len(places), dtype=np.int32), numbers).all_paired


@jit
def _group(merged: IntArray, faces: IntArray, starts: AnyArray, ends: IntArray, numbers: IntArray) -> tuple[int, int]:
    """Edges of vertex i lead to ``ends[starts[i]:starts[i + 1]]``, sorted; edge k of face f has the number 3 f + k.

    Returned is how many belong to one face alone, and how many to more than two.
    """
    for face in range(faces.shape[0]):
        a, b, c = merged[faces[face, 0]], merged[faces[face, 1]], merged[faces[face, 2]]
        if a != b and b != c and c != a:
            starts[min(a, b)] += 1
            starts[min(b, c)] += 1
            starts[min(c, a)] += 1
    total = 0
    for vertex in range(starts.shape[0]):
        total += starts[vertex]
        starts[vertex] = total  # the end of each group; filling from behind turns it into the start
    for face in range(faces.shape[0]):
        a, b, c = int(merged[faces[face, 0]]), int(merged[faces[face, 1]]), int(merged[faces[face, 2]])
        if a != b and b != c and c != a:
            _put(a, b, 3 * face, starts, ends, numbers)
            _put(b, c, 3 * face + 1, starts, ends, numbers)
            _put(c, a, 3 * face + 2, starts, ends, numbers)
    single, crowded = 0, 0
    for vertex in range(starts.shape[0] - 1):
        first, last = starts[vertex], starts[vertex + 1]
        if last - first > 1:
            _sort(ends[first:last], numbers[first:last])
        while first < last:
            end = _run(ends, first, last)
            single += end - first == 1
            crowded += end - first > 2
            first = end
    return single, crowded


@jit
def _put(a: int, b: int, number: int, starts: AnyArray, ends: IntArray, numbers: IntArray) -> None:
    low = min(a, b)
    starts[low] -= 1
    place = starts[low]
    ends[place], numbers[place] = max(a, b), number


@jit
def _sort(keys: IntArray, values: IntArray) -> None:
    """Sort keys, and values with them, in place: a heap sort where a vertex is too popular for insertion."""
    count = keys.shape[0]
    if count <= _INSERTED:
        for index in range(1, count):
            key, value, place = keys[index], values[index], index
            while place > 0 and keys[place - 1] > key:
                keys[place], values[place] = keys[place - 1], values[place - 1]
                place -= 1
            keys[place], values[place] = key, value
        return
    for start in range(count // 2 - 1, -1, -1):
        _sift(keys, values, start, count)
    for end in range(count - 1, 0, -1):
        keys[0], keys[end] = keys[end], keys[0]
        values[0], values[end] = values[end], values[0]
        _sift(keys, values, 0, end)


@jit
def _sift(keys: IntArray, values: IntArray, root: int, end: int) -> None:
    while 2 * root + 1 < end:
        child = 2 * root + 1
        if child + 1 < end and keys[child] < keys[child + 1]:
            child += 1
        if keys[root] >= keys[child]:
            return
        keys[root], keys[child] = keys[child], keys[root]
        values[root], values[child] = values[child], values[root]
        root = child


@jit
def _run(ends: IntArray, first: int, last: int) -> int:
    """The end of the run of equal numbers that begins at ``first``."""
    end = first + 1
    while end < last and ends[end] == ends[first]:
        end += 1
    return end


@jit
def _find_open(starts: AnyArray, ends: IntArray, numbers: IntArray, result: BoolArray) -> None:
    for vertex in range(starts.shape[0] - 1):
        place, last = starts[vertex], starts[vertex + 1]
        while place < last:
            end = _run(ends, place, last)
            if end - place == 1:
                result[numbers[place] // 3, numbers[place] % 3] = True
            place = end


@jit
def _find_neighbours(starts: AnyArray, ends: IntArray, numbers: IntArray, result: IntArray) -> None:
    for vertex in range(starts.shape[0] - 1):
        place, last = starts[vertex], starts[vertex + 1]
        while place < last:
            end = _run(ends, place, last)
            if end - place == 2:
                one, other = numbers[place], numbers[place + 1]
                result[one // 3, one % 3], result[other // 3, other % 3] = other // 3, one // 3
            place = end


@jit
def _first(starts: AnyArray, ends: IntArray, low: int, high: int) -> int:
    """Where the edges from a vertex to a higher one begin; where they would, if there is none."""
    first, last = starts[low], starts[low + 1]
    while first < last:
        middle = (first + last) // 2
        if ends[middle] < high:
            first = middle + 1
        else:
            last = middle
    return int(first)


@jit
def _look_up_neighbours(
    some: IntArray,
    merged: IntArray,
    faces: IntArray,
    starts: AnyArray,
    ends: IntArray,
    numbers: IntArray,
    result: IntArray,
) -> None:
    for index in range(len(some)):
        face = some[index]
        corners = merged[faces[face, 0]], merged[faces[face, 1]], merged[faces[face, 2]]
        if corners[0] == corners[1] or corners[1] == corners[2] or corners[2] == corners[0]:
            continue
        for edge in range(3):
            one, other = corners[edge], corners[(edge + 1) % 3]
            low, high = int(min(one, other)), int(max(one, other))
            place = _first(starts, ends, low, high)
            if _run(ends, place, int(starts[low + 1])) - place == 2:
                beside = numbers[place] // 3
                result[index, edge] = beside if beside != face else numbers[place + 1] // 3


@jit
def _find_edges(pairs: IntArray, starts: AnyArray, ends: IntArray, result: BoolArray) -> None:
    for index in range(pairs.shape[0]):
        low, high = min(pairs[index, 0], pairs[index, 1]), max(pairs[index, 0], pairs[index, 1])
        place = _first(starts, ends, low, high) if low >= 0 else 0
        result[index] = low >= 0 and place < starts[low + 1] and ends[place] == high


@jit
def _find_faces_at(triples: IntArray, starts: AnyArray, ends: IntArray, numbers: IntArray, result: IntArray) -> None:
    for index in range(triples.shape[0]):
        for side in range(3):
            one, other = triples[index, side], triples[index, (side + 1) % 3]
            low, high = min(one, other), max(one, other)
            if low < 0:
                continue
            place = _first(starts, ends, low, high)
            for step in range(2):
                if place + step < starts[low + 1] and ends[place + step] == high:
                    result[index, 2 * side + step] = numbers[place + step] // 3


@jit
def _find_faces(
    triples: IntArray,
    merged: IntArray,
    faces: IntArray,
    starts: AnyArray,
    ends: IntArray,
    numbers: IntArray,
    result: BoolArray,
) -> None:
    for index in range(triples.shape[0]):
        a, b, c = triples[index, 0], triples[index, 1], triples[index, 2]
        result[index] = False
        low, high = min(a, b, c), max(a, b, c)
        if low < 0:
            continue
        middle = a + b + c - low - high
        place = _first(starts, ends, low, middle)
        for step in range(place, min(place + _LOOKED_AT, starts[low + 1])):
            if ends[step] != middle:
                break
            face = numbers[step] // 3
            if merged[faces[face, (numbers[step] % 3 + 2) % 3]] == high:
                result[index] = True
                break
