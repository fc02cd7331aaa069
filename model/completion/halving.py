"""One side of a plane: cut exactly there, open or closed by a lid."""

from dataclasses import dataclass

from model.completion.closing import closed_part
from model.completion.half_space import ON_LID, ON_PLANE, half_space, merged
from model.geometry.integrals import unit_frame
from model.meshes.mesh import Mesh
from model.types import FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class Half:
    """One side of a plane: vertices ``(v, 3)``, faces ``(f, 3)``, and whether the cut is closed by a lid.

    ``overlapping`` bodies that do so in the cut are closed each alone.
    """

    vertices: FloatArray
    faces: IntArray
    capped: bool
    overlapping: int = 0


def halve(mesh: Mesh, plane: FloatArray, *, positive: bool = True, capped: bool = False) -> Half:
    """The part of a mesh on one side of a plane, cut exactly there.

    Args:
        mesh: any mesh.
        plane: ``(n, d)`` ``(4,)`` with unit normal, in the mesh's coordinates.
        positive: the side where ``n.x + d`` is positive, or else the other.
        capped: whether the cut is closed, so that half a solid is a solid. Where the outline of the cut is open or
            crosses itself this is not done, and the result says so.

    Returns:
        the half in the mesh's coordinates.

    Raises:
        DegenerateMeshError: nothing of the mesh is on that side.
    """
    scale = unit_frame(mesh.vertices, mesh.faces).scale
    vertices, faces = merged(mesh)
    plane = plane if positive else -plane
    if capped and (closed := closed_part(vertices, faces, plane[None], ON_LID * scale)) is not None:
        return Half(closed.vertices, closed.faces, True, closed.overlapping)
    return Half(*half_space(vertices, faces, plane, ON_PLANE * scale), False)
