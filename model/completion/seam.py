"""Joining an added part to a surface: its border is moved onto the surface's, and each gets the other's corners.

Without the second step the surfaces would touch, but an edge of the one would run along several of the other, and
nothing would be closed.
"""

import itertools
from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from model.completion.missing import MissingRegion
from model.geometry.surface import SurfaceIndex
from model.geometry.topology import occurs_once
from model.meshes.clipping import nondegenerate_mask
from model.types import AnyArray, FloatArray, IntArray

_REACH, _CORNER = 3.0, 1.5
"""In tolerances: how far the rim may be to be what a border belongs to, and a corner to be what a point there is."""

_SLACK = 8.0
_LONGEST_WALK = 200
_DETOUR = 1.6


@dataclass(frozen=True, slots=True, eq=False)
class Joined:
    """A surface and what was added to it, joined.

    Attributes:
        vertices: ``(v, 3)``, those of the surface first and unmoved.
        faces: ``(f, 3)``.
        kept: how many of the faces are the surface's.
        moved: the farthest that a vertex of the added part was moved, in the unit of the coordinates.
    """

    vertices: FloatArray
    faces: IntArray
    kept: int
    moved: float


@dataclass(slots=True)
class _Rim:
    """The open edges of a surface: which face each belongs to, and the neighbours of every vertex along them."""

    faces: dict[tuple[int, int], int] = field(default_factory=dict[tuple[int, int], int])
    neighbours: dict[int, list[int]] = field(default_factory=lambda: defaultdict(list))


def join(surface: SurfaceIndex, vertices: FloatArray, faces: IntArray, part: MissingRegion, tolerance: float) -> Joined:
    """Add a missing part to a surface.

    Args:
        surface: the index of ``vertices`` and ``faces``.
        vertices: ``(v, 3)`` of the surface, those at one place merged.
        faces: ``(f, 3)``.
        part: what to add, in the same frame.
        tolerance: how far the part's border is from the surface.
    """
    rim = _rim(faces)
    border = np.flatnonzero(part.on_border)
    targets, squared, _ = surface.closest(part.vertices[border])
    added = part.vertices.copy()
    # Where in the joined mesh every vertex of the part is: a new one, or the surface's.
    index = len(vertices) + np.arange(len(added))
    on_edges: dict[tuple[int, int], list[tuple[float, int]]] = defaultdict(list)
    if rim.faces:
        edges = np.array(list(rim.faces), dtype=np.int32)
        # An edge is a triangle without area to the index.
        index_of_rim = SurfaceIndex(vertices, edges[:, [0, 1, 1]], work=surface.work_left)
        nearby, rim_squared, owners = index_of_rim.closest(part.vertices[border])
        near = rim_squared <= (_REACH * tolerance) ** 2
        targets[near], squared[near] = nearby[near], rim_squared[near]
        for vertex, target, edge in zip(border[near], nearby[near], edges[owners[near]].tolist(), strict=True):
            corner, share = _place(vertices, (edge[0], edge[1]), target, tolerance)
            if corner is None:
                on_edges[edge[0], edge[1]].append((share, int(index[vertex])))
            else:
                index[vertex] = corner
    added[border] = targets
    everything = np.concatenate([vertices, added])
    _share_points(on_edges, everything, index, len(vertices), tolerance)
    kept = _split_faces(faces, rim, {edge: sorted(points) for edge, points in on_edges.items()})
    between = _edge_of(on_edges)
    new = index[part.faces].astype(np.int32)
    new = new[nondegenerate_mask(new)]
    new = _split_along(new, rim, between, everything, len(vertices), _SLACK * tolerance)
    result = np.concatenate([kept, new]).astype(np.int32)
    return Joined(everything, result, len(kept), float(np.sqrt(squared.max(initial=0.0))))


def _rim(faces: IntArray) -> _Rim:
    """The edges that belong to one face only."""
    edges = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    lower, upper = np.minimum(*edges.T).astype(np.int64), np.maximum(*edges.T).astype(np.int64)
    once = np.flatnonzero(occurs_once(lower * (int(faces.max()) + 1) + upper))
    rim = _Rim()
    for a, b, face in zip(lower[once].tolist(), upper[once].tolist(), (once // 3).tolist(), strict=True):
        rim.faces[a, b] = face
        rim.neighbours[a].append(b)
        rim.neighbours[b].append(a)
    return rim


def _place(
    vertices: FloatArray, edge: tuple[int, int], target: FloatArray, tolerance: float
) -> tuple[int | None, float]:
    """The end of an edge that a point on it is next to, if it is, and how far along the edge the point is."""
    start, along = vertices[edge[0]], vertices[edge[1]] - vertices[edge[0]]
    length = float(np.linalg.norm(along))
    share = float((target - start) @ along) / max(length, 1e-300) ** 2
    near = min(_CORNER * tolerance / max(length, 1e-300), 0.5)
    return (edge[0] if share <= near else edge[1] if share >= 1.0 - near else None), share


def _share_points(
    on_edges: dict[tuple[int, int], list[tuple[float, int]]],
    points: FloatArray,
    index: AnyArray,
    first: int,
    tolerance: float,
) -> None:
    """Make one of the part's vertices that meet at one place of an edge."""
    for edge, entries in on_edges.items():
        kept: list[tuple[float, int]] = []
        for share, vertex in sorted(entries):
            if kept and np.linalg.norm(points[kept[-1][1]] - points[vertex]) <= tolerance:
                index[vertex - first] = kept[-1][1]
            else:
                kept.append((share, vertex))
        on_edges[edge] = kept


def _edge_of(on_edges: dict[tuple[int, int], list[tuple[float, int]]]) -> dict[int, tuple[tuple[int, int], float]]:
    """For every vertex on an edge of the rim that edge, and how far along."""
    return {vertex: (edge, share) for edge, entries in on_edges.items() for share, vertex in entries}


def _split_faces(faces: IntArray, rim: _Rim, points: dict[tuple[int, int], list[tuple[float, int]]]) -> AnyArray:
    """The surface's faces with the points on their open edges made corners: fans, one edge after the other."""
    wanted: dict[int, list[tuple[int, int]]] = defaultdict(list)
    for edge in points:
        wanted[rim.faces[edge]].append(edge)
    whole = np.ones(len(faces), dtype=np.bool_)
    pieces: list[list[int]] = []
    for face, edges in wanted.items():
        whole[face] = False
        triangles = [[int(corner) for corner in faces[face]]]
        for edge in edges:
            inserted = [vertex for _, vertex in points[edge]]
            triangles = [piece for triangle in triangles for piece in _fan(triangle, edge, inserted)]
        pieces += triangles
    return np.concatenate([faces[whole], np.array(pieces, dtype=np.int32).reshape(-1, 3)])


def _fan(triangle: list[int], edge: tuple[int, int], inserted: list[int]) -> list[list[int]]:
    """A triangle cut at points on one of its edges, listed from ``edge[0]`` to ``edge[1]``; others stay as they are."""
    for turn in range(3):
        a, b, c = triangle[turn], triangle[(turn + 1) % 3], triangle[(turn + 2) % 3]
        if (a, b) == edge or (b, a) == edge:
            line = [a, *(inserted if a == edge[0] else reversed(inserted)), b]
            return [[p, q, c] for p, q in itertools.pairwise(line)]
    return [triangle]


def _split_along(
    faces: IntArray,
    rim: _Rim,
    between: dict[int, tuple[tuple[int, int], float]],
    points: FloatArray,
    first: int,
    slack: float,
) -> AnyArray:
    """The part's faces with the rim's vertices along their open edges made corners."""
    own = _rim(faces) if len(faces) else _Rim()
    whole = np.ones(len(faces), dtype=np.bool_)
    cuts: dict[int, list[tuple[tuple[int, int], list[int]]]] = defaultdict(list)
    for edge, face in own.faces.items():
        walked = _walk(rim, between, points, first, *edge, slack)
        if walked:
            cuts[face].append((edge, walked))
    pieces: list[list[int]] = []
    for face, found in cuts.items():
        whole[face] = False
        triangles = [[int(corner) for corner in faces[face]]]
        for edge, inserted in found:
            triangles = [piece for triangle in triangles for piece in _fan(triangle, edge, inserted)]
        pieces += triangles
    return np.concatenate([faces[whole], np.array(pieces, dtype=np.int32).reshape(-1, 3)])


def _walk(
    rim: _Rim,
    between: dict[int, tuple[tuple[int, int], float]],
    points: FloatArray,
    first: int,
    start: int,
    end: int,
    slack: float,
) -> list[int]:
    """The vertices of the rim on the way along it from one vertex to another, if it is hardly longer than straight."""

    def doors(vertex: int) -> tuple[int, ...] | None:
        if vertex < first:
            return (vertex,) if vertex in rim.neighbours else None
        return between[vertex][0] if vertex in between else None

    starts, ends = doors(start), doors(end)
    if starts is None or ends is None:
        return []
    if start >= first and end >= first and between[start][0] == between[end][0]:
        return []
    if (start < first and start in ends) or (end < first and end in starts):
        return []
    straight = float(np.linalg.norm(points[start] - points[end]))
    best: list[int] = []
    shortest = _DETOUR * straight + slack
    begins = rim.neighbours[start] if start < first else starts
    for begin in begins:
        path, previous, length = [begin], start if start < first else _other(starts, begin), 0.0
        length = float(np.linalg.norm(points[start] - points[begin]))
        while length < shortest and len(path) < _LONGEST_WALK:
            here = path[-1]
            if here in ends:
                total = length + float(np.linalg.norm(points[here] - points[end]))
                if total < shortest:
                    best, shortest = path[:-1] if here == end else list(path), total
                break
            ahead = [vertex for vertex in rim.neighbours[here] if vertex != previous]
            if len(ahead) != 1:
                break
            length += float(np.linalg.norm(points[here] - points[ahead[0]]))
            previous = here
            path.append(ahead[0])
    return best


def _other(ends: tuple[int, ...], vertex: int) -> int:
    return ends[1] if vertex == ends[0] else ends[0]
