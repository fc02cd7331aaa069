"""What is on one side of a plane, open where it was cut or with a lid there."""

from typing import Literal

import numpy as np

from model.completion.lids import lid
from model.errors import DegenerateMeshError
from model.geometry.surface import SurfaceIndex
from model.geometry.topology import duplicate_vertex_map
from model.meshes.clipping import clip, nondegenerate_mask, remove_unreferenced_vertices
from model.meshes.mesh import Mesh
from model.types import FloatArray, IntArray

ON_PLANE = 1e-9
"""Unit frame. A vertex nearer to the plane than this is on it."""

ON_LID = 1e-6
"""The same where the cut is closed: some steps of 32-bit coordinates. Vertices that a plane should go through are
beside it by as much, and slivers between them and the cut would be in the way of those who mesh the solid."""


def capped_half_space(
    vertices: FloatArray, faces: IntArray, plane: FloatArray, rounding: float
) -> tuple[FloatArray, IntArray] | None:
    """What is on the positive side of a plane with a lid on the cut; None where there is no telling what is inside.

    Raises:
        DegenerateMeshError: nothing of the mesh is on that side.
    """
    half, half_faces = half_space(vertices, faces, plane, rounding, lying="none")
    cover = lid(half, half_faces, plane, rounding)
    return None if cover is None else (half, np.concatenate([half_faces, cover]))


def merged(mesh: Mesh) -> tuple[FloatArray, IntArray]:
    """Vertices and faces with those at one place made one, unused ones and faces without corners dropped."""
    faces = duplicate_vertex_map(mesh.vertices)[mesh.faces]
    faces = faces[nondegenerate_mask(faces)]
    vertices, faces, _ = remove_unreferenced_vertices(mesh.vertices, faces)
    return vertices, faces


def half_space(
    vertices: FloatArray,
    faces: IntArray,
    plane: FloatArray,
    rounding: float,
    *,
    lying: Literal["own", "all", "none"] = "own",
) -> tuple[FloatArray, IntArray]:
    """What is on the positive side of a plane; vertices within ``rounding`` of it are put on it.

    Of the faces within the plane those that bound this side stay (``own``), or all, or none. Both sides of one plane
    are cut at the same points, to the last bit.

    Raises:
        DegenerateMeshError: nothing of the mesh is on that side.
    """
    normal, offset = plane[:3], plane[3]
    height = vertices @ normal + offset
    near = np.abs(height) <= rounding
    vertices = np.where(near[:, None], vertices - height[:, None] * normal, vertices)
    height = np.where(near, 0.0, height)
    # A face that only touches the plane belongs to the side it is on.
    above = (height[faces] >= 0.0).all(axis=1)
    crossed = faces[(height[faces].max(axis=1) > 0.0) & ~above]

    def crossing(inside: FloatArray, outside: FloatArray) -> FloatArray:
        first, last = _ordered(inside, outside)
        low, high = first @ normal + offset, last @ normal + offset
        points = first + (low / (low - high))[:, None] * (last - first)
        points -= (points @ normal + offset)[:, None] * normal
        # Where an end is on the plane itself it is the point, to the last bit, and slivers between them go.
        points = np.where((np.abs(low) <= rounding)[:, None], first, points)
        return np.where((np.abs(high) <= rounding)[:, None], last, points)

    clipped = clip(vertices, crossed, height >= 0.0, crossing)
    pieces = clipped.faces
    corners = np.append(height >= 0.0, np.ones(len(clipped.vertices) - len(height), dtype=np.bool_))
    pieces = pieces[corners[pieces].all(axis=1)]
    kept = faces[above]
    if lying == "own":
        kept = _single_wall(vertices, kept, height, normal, rounding)
    elif lying == "none":
        kept = kept[(height[kept] > 0.0).any(axis=1)]
    result = np.concatenate([kept, pieces])
    if not len(result):
        raise DegenerateMeshError("Nothing of the mesh is on that side of the plane.")
    places = duplicate_vertex_map(clipped.vertices)[result]
    half, half_faces, _ = remove_unreferenced_vertices(clipped.vertices, places[nondegenerate_mask(places)])
    return half, half_faces


def _ordered(ones: FloatArray, others: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ends of edges ``(k, 3)``, the lower one first: which side is kept makes no difference then."""
    apart = ones - others
    first = np.argmax(apart != 0.0, axis=1)
    swapped = (apart[np.arange(len(apart)), first] > 0.0)[:, None]
    return np.where(swapped, others, ones), np.where(swapped, ones, others)


def _single_wall(
    vertices: FloatArray, faces: IntArray, height: FloatArray, normal: FloatArray, rounding: float
) -> IntArray:
    """Faces on the positive side without the other side's wall: two bodies that are glued have two walls in the plane.

    The wall of the side that is kept faces away from it. A face that looks the other way is dropped where one of those
    lies on the same place, and so is a face of which there is a copy.
    """
    lying = (height[faces] == 0.0).all(axis=1)
    if lying.sum() < 2:
        return faces
    wall = faces[lying]
    _, first = np.unique(np.sort(wall, axis=1), axis=0, return_index=True)
    corners = vertices[wall]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) @ normal
    own = np.flatnonzero(areas < 0.0)
    keep = np.zeros(len(wall), dtype=np.bool_)
    keep[first] = True
    if len(own) and (areas > 0.0).any():
        # Copies that look both ways: the one that looks away from this side is the one to keep.
        _, mine = np.unique(np.sort(wall[own], axis=1), axis=0, return_index=True)
        keep = areas > 0.0
        keep[own[mine]] = True
        other = np.flatnonzero(areas > 0.0)
        index = SurfaceIndex(*remove_unreferenced_vertices(vertices, wall[own])[:2])
        _, squared, _ = index.closest(np.ascontiguousarray(corners[other].mean(axis=1)))
        keep[other[squared <= (2.0 * rounding) ** 2]] = False
    return np.concatenate([faces[~lying], wall[keep]])
