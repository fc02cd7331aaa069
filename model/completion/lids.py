"""Lids: what closes a surface where a plane has cut it."""

from dataclasses import dataclass

import mapbox_earcut
import numpy as np

from model.geometry.straight_corners import signed_areas, with_straight_corners, without_slivers
from model.types import AnyArray, FloatArray, IntArray

_MOST_EDGES = 100_000
"""Of all outlines."""

_MOST_CORNERS = 20_000
"""Of a lid that is one region: the time to triangulate one may grow with their square, which is added up for several.
"""

_MOST_COMPARISONS = 3e8
"""Edges looked at to tell which outline is inside which."""

_VIEWS = (0.6180, 1.7320, 2.6457)
"""Angles a lid is seen at. Along coordinate axes, as drawn, corners line up that have nothing to do with each other."""

_UNCOVERED = 1e-6
"""Share of a lid's area that its triangles may differ from what its outlines enclose, by rounding."""


@dataclass(frozen=True, slots=True, eq=False)
class _Region:
    """An outline ``(k,)`` and the outlines of the holes in it, as places in the list of points."""

    rings: list[AnyArray]


def lid(vertices: FloatArray, faces: IntArray, plane: FloatArray, rounding: float) -> IntArray | None:
    """Triangles that close a surface within a plane, looking away from its positive side.

    What an odd number of outlines encloses is inside the solid. Every edge of the outlines gets one triangle, so that
    a closed surface that was cut is closed again.

    Args:
        vertices: ``(v, 3)``, each place once.
        faces: ``(f, 3)``, none within the plane.
        plane: ``(n, d)`` ``(4,)`` with unit normal.
        rounding: how far from the plane a vertex is that is on it.

    Returns:
        ``(t, 3)``; None where outlines are open or cross, so that nobody knows what is inside, or are too many.
    """
    edges = _outline_edges(faces, np.abs(vertices @ plane[:3] + plane[3]) <= 4.0 * rounding)
    if not len(edges):
        return np.empty((0, 3), dtype=np.int32)
    if len(edges) > _MOST_EDGES or (np.bincount(edges.ravel()) % 2).any():
        return None
    corners, local = np.unique(edges, return_inverse=True)
    local = local.reshape(-1, 2)
    flat = _seen_from_below(vertices[corners], plane[:3])
    regions = _regions(flat, _rings(flat, local))
    if regions is None:
        return None
    for angle in _VIEWS:
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        seen = np.ascontiguousarray(flat @ turn)
        triangles = np.concatenate([_triangulated(seen, region) for region in regions])
        if _covers(seen, triangles, local, regions):
            return corners[triangles].astype(np.int32)
    return None


def _outline_edges(faces: IntArray, on_plane: AnyArray) -> AnyArray:
    """Edges ``(e, 2)`` within the plane that an odd number of faces have."""
    edges, counts = counted_edges(faces, on_plane)
    return edges[counts % 2 == 1]


def counted_edges(faces: AnyArray, among: AnyArray | None = None) -> tuple[AnyArray, AnyArray]:
    """Edges ``(e, 2)`` of faces ``(f, 3)``, each once with its lower vertex first, and how many faces have it ``(e,)``.

    ``among``: which vertices both ends have to be of.
    """
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    if among is not None:
        edges = edges[among[edges].all(axis=1)]
    unique, counts = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    return unique.reshape(-1, 2), counts


def _seen_from_below(points: FloatArray, normal: FloatArray) -> FloatArray:
    """Points within a plane as (n, 2), so that what is counter-clockwise looks against the normal."""
    return np.ascontiguousarray((points - points.mean(axis=0)) @ view_from_below(normal))


def view_from_below(normal: FloatArray) -> FloatArray:
    """Directions ``(3, 2)`` within a plane, to the right and up for who looks along its normal."""
    across = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    across /= np.linalg.norm(across)
    return np.ascontiguousarray(np.stack([np.cross(normal, across), across], axis=1), dtype=np.float64)


def _rings(flat: FloatArray, edges: AnyArray) -> list[AnyArray]:
    """The edges as closed rings in which no corner comes twice; where four edges meet, rings touch and do not cross."""
    neighbours: list[list[int]] = [list[int]() for _ in flat]
    pairs: list[list[int]] = edges.tolist()
    for a, b in pairs:
        neighbours[a].append(b)
        neighbours[b].append(a)
    rings: list[AnyArray] = []
    # Begun at corners of two edges, where there is no question how to go on.
    for start in sorted(range(len(flat)), key=lambda corner: len(neighbours[corner]) > 2):
        while neighbours[start]:
            path, places = [start], {start: 0}
            begin = -1
            while begin != 0:
                here = path[-1]
                to = _next(flat, path[-2] if len(path) > 1 else -1, here, neighbours[here])
                neighbours[here].remove(to)
                neighbours[to].remove(here)
                begin = places.get(to, -1)
                if begin < 0:
                    places[to] = len(path)
                    path.append(to)
                    continue
                ring = path[begin:]
                rings.append(np.array(ring, dtype=np.int64))
                for corner in ring[1:]:
                    del places[corner]
                del path[begin + 1 :]
    return rings


def _next(flat: FloatArray, before: int, here: int, choices: list[int]) -> int:
    """Which corner comes next: the first one counter-clockwise from where the way came from."""
    if len(choices) == 1 or before < 0:
        return choices[0]
    back = flat[before] - flat[here]
    angles: list[float] = []
    for choice in choices:
        way = flat[choice] - flat[here]
        angle = float(np.arctan2(back[0] * way[1] - back[1] * way[0], back @ way))
        angles.append(angle if angle > 0.0 else angle + 2.0 * np.pi)
    return choices[int(np.argmin(angles))]


def _regions(flat: FloatArray, rings: list[AnyArray]) -> list[_Region] | None:
    """Outlines and the holes that are in them, outlines counter-clockwise and holes the other way.

    None where there is too much of it.
    """
    edges = sum(map(len, rings))
    if len(rings) * edges > _MOST_COMPARISONS:
        return None
    starts = np.concatenate(rings)
    ends = np.concatenate([np.roll(ring, -1) for ring in rings])
    owner = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])
    crosses = flat[starts, 0] * flat[ends, 1] - flat[starts, 1] * flat[ends, 0]
    areas = np.bincount(owner, crosses, minlength=len(rings)) / 2.0
    within = np.array(
        [_around(flat, starts, ends, owner, ring, number, len(rings)) for number, ring in enumerate(rings)]
    )
    depth = within.sum(axis=1)
    found: dict[int, _Region] = {}
    for number in np.flatnonzero(depth % 2 == 0).tolist():
        found[number] = _Region([rings[number] if areas[number] > 0.0 else rings[number][::-1]])
    for number in np.flatnonzero(depth % 2 == 1).tolist():
        outer = [other for other in np.flatnonzero(within[number]).tolist() if depth[other] == depth[number] - 1]
        if len(outer) != 1:
            return None
        found[outer[0]].rings.append(rings[number] if areas[number] < 0.0 else rings[number][::-1])
    regions = list(found.values())
    return None if sum(sum(map(len, region.rings)) ** 2 for region in regions) > _MOST_CORNERS**2 else regions


def _around(
    flat: FloatArray, starts: AnyArray, ends: AnyArray, owner: AnyArray, ring: AnyArray, number: int, rings: int
) -> AnyArray:
    """Which of all rings go around one of them: by the middle of its longest edge, which no corner of others is at."""
    lengths = np.linalg.norm(flat[ring] - flat[np.roll(ring, -1)], axis=1)
    longest = int(np.argmax(lengths))
    x, y = (flat[ring[longest]] + flat[ring[(longest + 1) % len(ring)]]) / 2.0
    a, b = flat[starts], flat[ends]
    straddles = (a[:, 1] > y) != (b[:, 1] > y)
    a, b, owner = a[straddles], b[straddles], owner[straddles]
    beyond = x < a[:, 0] + (y - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
    inside = np.bincount(owner[beyond], minlength=rings) % 2 == 1
    inside[number] = False
    return inside


def _triangulated(flat: FloatArray, region: _Region) -> AnyArray:
    """Triangles (t, 3) of a region, counter-clockwise, with all of its corners."""
    corners = np.concatenate(region.rings)
    ends = np.cumsum([len(ring) for ring in region.rings])
    points = np.ascontiguousarray(flat[corners])
    ears = mapbox_earcut.triangulate_float64(points, ends.astype(np.uint32)).reshape(-1, 3).astype(np.int64)
    areas = signed_areas(points, ears)
    if areas.sum() < 0.0:
        ears = ears[:, ::-1]
    if len(ears) < len(corners) + 2 * (len(ends) - 1) - 2:
        following = np.arange(1, len(corners) + 1)
        following[ends - 1] = np.append(0, ends[:-1])
        ears = with_straight_corners(points, ears, following, float(abs(areas.sum())))
    return corners[without_slivers(points, ears)]


def _covers(flat: FloatArray, triangles: AnyArray, edges: AnyArray, regions: list[_Region]) -> bool:
    """Whether triangles have each edge of the outlines once, all others twice, and the area that is enclosed."""
    sides, counts = counted_edges(triangles)
    single = sides[counts == 1]
    if (counts > 2).any() or len(single) != len(edges) or (single != np.unique(edges, axis=0)).any():
        return False
    rings = [ring for region in regions for ring in region.rings]
    starts, ends = flat[np.concatenate(rings)], flat[np.concatenate([np.roll(ring, -1) for ring in rings])]
    enclosed = float((starts[:, 0] * ends[:, 1] - starts[:, 1] * ends[:, 0]).sum()) / 2.0
    areas = signed_areas(flat, triangles)
    return max(abs(float(total) - enclosed) for total in (areas.sum(), np.abs(areas).sum())) <= _UNCOVERED * enclosed
