"""What a mirror plane is good for: completing a mesh (the paper, Section 6), making it symmetric.

All work in the unit frame inside and in the caller's coordinates outside; what was there keeps its coordinates to the
last digit.
"""

from dataclasses import dataclass

import numpy as np

from model.completion.halving import ON_PLANE, half_space, merged
from model.completion.missing import estimate_tolerance, find_missing
from model.completion.seam import join
from model.geometry.frames import triangle_areas
from model.geometry.integrals import unit_frame
from model.geometry.sampling import sample_surface
from model.geometry.surface import WORK, SurfaceIndex
from model.geometry.transforms import reflect
from model.meshes.clipping import remove_unreferenced_vertices
from model.meshes.mesh import Mesh
from model.meshes.subdivision import edge_lengths
from model.types import FloatArray, IntArray

_SAMPLES = 2000
_WORK_A_FACE = 100
"""Each face is asked about a few times. Well-shaped ones take a tenth of this, fans of slivers most of it."""


@dataclass(frozen=True, slots=True, eq=False)
class Completed:
    """A mesh with what its mirror image had and it lacked. Lengths in its own unit.

    Attributes:
        vertices: ``(v, 3)`` float64, those of the mesh first.
        faces: ``(f, 3)`` int32, those of the mesh first.
        vertices_kept: how many of the vertices are the mesh's, merged where they coincide.
        faces_kept: how many of the faces are.
        area_added: what was added, as a share of the mesh's area.
        tolerance: what was nearer to its mirror image than this was not missing.
        seam_distance: the farthest that the border of an added part was moved to close the seam.
        symmetry_error: of the mesh as it came, at this plane (SDE, unit frame).
    """

    vertices: FloatArray
    faces: IntArray
    vertices_kept: int
    faces_kept: int
    area_added: float
    tolerance: float
    seam_distance: float
    symmetry_error: float


def complete(mesh: Mesh, plane: FloatArray, *, symmetrize: bool = False) -> Completed:
    """Add to a mesh the mirror image of what the other side of a plane has and this one lacks.

    What lies on both sides stays as it is, be it exactly symmetric or not; a part that is missing on both sides stays
    missing. The seam is closed where the mesh has an open border. With ``symmetrize`` the surface is then moved half
    way to its mirror image, and one half taken for both: the result is symmetric to rounding.

    Args:
        mesh: any mesh.
        plane: ``(n, d)`` ``(4,)`` with unit normal, in the mesh's coordinates.
        symmetrize: whether to average the halves.

    Raises:
        DegenerateMeshError: nothing of the mesh is left on one side of a plane it should be symmetric about.
        TooComplexError: its faces crowd so much, or would have to be cut so often, that it would take too long.
    """
    frame = unit_frame(mesh.vertices, mesh.faces)
    own, faces = merged(mesh)
    vertices = frame.to_unit(own)
    plane = frame.plane_to_unit(plane)
    surface = SurfaceIndex(vertices, faces, work=_work(faces))
    samples = reflect(sample_surface(vertices, faces, _SAMPLES, seed=0)[0], plane)
    squared = surface.squared_distances(samples)
    tolerance = estimate_tolerance(np.sqrt(squared))
    part = find_missing(surface, vertices, reflect(vertices, plane), np.ascontiguousarray(faces[:, ::-1]), tolerance)
    joined = join(surface, vertices, faces, part, tolerance)
    area = triangle_areas(vertices[faces]).sum()
    added = triangle_areas(joined.vertices[joined.faces[joined.kept :]]).sum()
    everything, all_faces, used = remove_unreferenced_vertices(joined.vertices, joined.faces)
    coordinates = frame.to_input(everything)
    kept = int(np.searchsorted(used, len(own)))
    coordinates[:kept] = own[used[:kept]]
    faces_kept = joined.kept
    if symmetrize:
        averaged, all_faces = _averaged(everything, all_faces, plane, tolerance)
        coordinates = frame.to_input(averaged)
        kept, faces_kept = len(coordinates) // 2, len(all_faces) // 2
    return Completed(
        vertices=np.ascontiguousarray(coordinates),
        faces=all_faces,
        vertices_kept=kept,
        faces_kept=faces_kept,
        area_added=float(added / area),
        tolerance=tolerance * frame.scale,
        seam_distance=joined.moved * frame.scale,
        symmetry_error=float(squared.mean()),
    )


def _work(faces: IntArray) -> float:
    """What may be done to measure distances to so many faces."""
    return WORK + _WORK_A_FACE * len(faces)


def _averaged(
    vertices: FloatArray, faces: IntArray, plane: FloatArray, tolerance: float
) -> tuple[FloatArray, IntArray]:
    """A surface that is exactly symmetric: half way between this one and its mirror image, and one half for both.

    Vertices farther than twice the tolerance from the mirror image have none to meet half way, and stay; those nearer
    to the plane than half of it are put on it.
    """
    surface = SurfaceIndex(vertices, faces, work=_work(faces))
    targets, squared, _ = surface.closest(reflect(vertices, plane))
    near = squared <= (2.0 * tolerance) ** 2
    middle = np.where(near[:, None], (vertices + reflect(targets, plane)) / 2.0, vertices)
    sides = [_side_area(middle, faces, plane * sign) for sign in (1.0, -1.0)]
    plane = plane if sides[0] >= sides[1] else -plane
    half, half_faces = half_space(middle, faces, plane, tolerance / 2.0)
    on_plane = np.abs(half @ plane[:3] + plane[3]) <= ON_PLANE
    other = np.where(on_plane, np.arange(len(half)), len(half) + np.cumsum(~on_plane) - 1)
    # A face within the plane is its own mirror image, unless it is what became of a thin one across it.
    lying = on_plane[half_faces].all(axis=1)
    wide = triangle_areas(half[half_faces]) > tolerance * edge_lengths(half, half_faces).max(axis=1)
    half_faces, lying = half_faces[~lying | wide], lying[~lying | wide]
    whole = np.concatenate([half, reflect(half[~on_plane], plane)])
    return whole, np.concatenate([half_faces, other[half_faces[~lying, ::-1]].astype(np.int32)])


def _side_area(vertices: FloatArray, faces: IntArray, plane: FloatArray) -> float:
    """Area of the faces whose centre is on the positive side."""
    corners = vertices[faces]
    return float(triangle_areas(corners)[corners.mean(axis=1) @ plane[:3] + plane[3] > 0.0].sum())
