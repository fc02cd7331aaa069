"""The sector of a mesh between two planes through a rotation axis: what a cyclic simulation needs of it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from model.completion.closing import closed_part
from model.completion.half_space import ON_LID, ON_PLANE, half_space, merged
from model.errors import NoAxisError
from model.geometry.integrals import unit_frame
from model.geometry.topology import duplicate_vertex_map
from model.geometry.transforms import rotation_matrix
from model.meshes.clipping import nondegenerate_mask, remove_unreferenced_vertices
from model.meshes.mesh import Mesh
from model.types import FloatArray, IntArray

_TRIED = 16
"""Places to cut that are looked at, and as many along mirror planes."""

_LOOKS = 8_000_000
"""Faces that are looked at for it: of larger meshes at fewer places."""

_HARDLY_LONGER = 1.05
"""A cut along a mirror plane may be so much longer than the shortest one."""

_MOST_MOVED = 1e-4
"""Unit frame. Vertices are moved so far at most."""


@dataclass(frozen=True, slots=True, eq=False)
class Sector:
    """One of ``order`` equal parts around an axis, in the mesh's coordinates.

    Attributes:
        vertices: ``(v, 3)`` float64.
        faces: ``(f, 3)`` int32.
        planes: ``(2, 4)`` the cuts ``(n, d)``, unit normals that point into the sector. Turning the first one by
            360/``order`` degrees, by the right-hand rule about the axis, gives the second.
        ends: ``(2, 3)`` points on the axis, at the lower and upper end of the whole mesh.
        order: how many of it make up the whole.
        capped: whether both cuts are closed.
        overlapping: how many bodies overlap in a cut and were closed each alone.
    """

    vertices: FloatArray
    faces: IntArray
    planes: FloatArray
    ends: FloatArray
    order: int
    capped: bool
    overlapping: int = 0


def cut_sector(
    mesh: Mesh,
    direction: FloatArray,
    point: FloatArray,
    order: int,
    *,
    start: FloatArray | None = None,
    mirrors: Sequence[FloatArray] = (),
    capped: bool = True,
    deviation: float = 0.0,
) -> Sector:
    """Cut one of ``order`` equal sectors out of a mesh, exactly at two planes through an axis.

    Args:
        mesh: any mesh.
        direction: ``(3,)`` unit direction of the axis.
        point: ``(3,)`` a point on it.
        order: how many sectors make up the whole, at least 2.
        start: ``(3,)`` the way from the axis that the first cut goes; without it where a short cut does.
        mirrors: unit normals of mirror planes through the axis: cut there, if that is hardly longer.
        capped: whether the cuts are closed, so that the sector of a solid is a solid. Where the outline of a cut is
            open or crosses itself this is not done, and the result says so.
        deviation: how far off the symmetry is; up to a 10,000th of the mesh's size vertices of a capped sector that
            are beside a cut by less are put on it, where there would be slivers.

    Raises:
        DegenerateMeshError: nothing of the mesh is in that sector.
        NoAxisError: the start is along the axis.
    """
    scale = unit_frame(mesh.vertices, mesh.faces).scale
    vertices, faces = merged(mesh)
    away = (
        _across(start, direction) if start is not None else _shortest(vertices, faces, direction, point, order, mirrors)
    )
    to = rotation_matrix(direction, 2.0 * np.pi / order) @ away
    normals = np.stack([np.cross(direction, away), np.cross(to, direction)])
    planes = np.column_stack([normals, -normals @ point])
    heights = (vertices - point) @ direction
    ends = point + np.outer([heights.min(), heights.max()], direction)
    cuts = planes if order > 2 else planes[:1]  # of two sectors both cuts are in one plane
    rounding = float(np.clip(deviation, ON_LID * scale, _MOST_MOVED * scale))
    closed = closed_part(_on_axis(vertices, direction, point, rounding), faces, cuts, rounding) if capped else None
    if closed is not None:
        result = closed.vertices, closed.faces
    else:
        rounding = ON_PLANE * scale
        result = vertices, faces
        for plane in cuts:
            result = half_space(*result, plane, rounding)
    if order == 2:
        result = _divided(*result, np.append(away, -away @ point), rounding)
    overlapping = 0 if closed is None else closed.overlapping
    return Sector(*result, planes, ends, order, closed is not None, overlapping)


def _on_axis(vertices: FloatArray, direction: FloatArray, point: FloatArray, rounding: float) -> FloatArray:
    """Vertices near the axis put on it: no cut moves them from the other one then."""
    foot = point + ((vertices - point) @ direction)[:, None] * direction
    near = np.linalg.norm(vertices - foot, axis=1) <= 2.0 * rounding
    return np.where(near[:, None], foot, vertices)


def _divided(vertices: FloatArray, faces: IntArray, plane: FloatArray, rounding: float) -> tuple[FloatArray, IntArray]:
    """The same surface with edges along a plane, so that a lid across the axis becomes two faces that meet in it."""
    height = vertices @ plane[:3] + plane[3]
    if height.min() > -rounding or height.max() < rounding:
        return vertices, faces
    one, one_faces = half_space(vertices, faces, plane, rounding, lying="all")
    other, other_faces = half_space(vertices, faces, -plane, rounding, lying="none")
    both = np.concatenate([one, other])
    joined = duplicate_vertex_map(both)[np.concatenate([one_faces, other_faces + len(one)])]
    both, joined, _ = remove_unreferenced_vertices(both, joined[nondegenerate_mask(joined)])
    return both, joined


def _shortest(
    vertices: FloatArray,
    faces: IntArray,
    direction: FloatArray,
    point: FloatArray,
    order: int,
    mirrors: Sequence[FloatArray],
) -> FloatArray:
    """The way from the axis along which a cut is short: between blades, teeth and spokes."""
    along = [_across(np.cross(direction, normal), direction) for normal in mirrors[: _TRIED // 2]]
    along += [-way for way in along]
    first = along[0] if along else _across(np.eye(3)[int(np.argmin(np.abs(direction)))], direction)
    tried = int(np.clip(_LOOKS // len(faces), 2, _TRIED))
    step = 2.0 * np.pi / (order * tried)
    others = [rotation_matrix(direction, step * k) @ first for k in range(0 if not along else 1, tried)]
    lengths = [_cut_length(vertices - point, faces, direction, way) for way in [*along, *others]]
    best = int(np.argmin(lengths))
    if along:
        mirror = int(np.argmin(lengths[: len(along)]))
        best = mirror if lengths[mirror] <= _HARDLY_LONGER * lengths[best] else best
    return [*along, *others][best]


def _cut_length(points: FloatArray, faces: IntArray, direction: FloatArray, away: FloatArray) -> float:
    """Length of the lines along which the half plane from the axis in one direction meets the surface."""
    height, out = points @ np.cross(direction, away), points @ away
    above = height > 0.0
    count = above[faces].sum(axis=1)
    cut = faces[((count == 1) | (count == 2)) & (out[faces].max(axis=1) > 0.0)]
    if not len(cut):
        return 0.0
    alone = np.argmax(above[cut] == (above[cut].sum(axis=1) == 1)[:, None], axis=1)
    cut = np.take_along_axis(cut, (alone[:, None] + np.arange(3)) % 3, axis=1)
    tip, others = cut[:, :1], cut[:, 1:]
    share = (height[tip] / (height[tip] - height[others]))[..., None]
    ends = points[tip] + share * (points[others] - points[tip])
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    reach = ends @ away
    low, high = reach.min(axis=1), reach.max(axis=1)
    wide = high > low
    outside = np.maximum(high, 0.0) - np.maximum(low, 0.0)
    shares = np.where(wide, outside / np.where(wide, high - low, 1.0), np.where(low > 0.0, 1.0, 0.0))
    return float((lengths * shares).sum())


def _across(way: FloatArray, direction: FloatArray) -> FloatArray:
    """A direction without its part along the axis, of length 1.

    Raises:
        NoAxisError: there is nothing else to it.
    """
    across = way - (way @ direction) * direction
    length = float(np.linalg.norm(across))
    if not length > 1e-6 * float(np.linalg.norm(way)):
        raise NoAxisError("The first cut would go along the axis itself. Give a start that leads away from it.")
    return across / length
