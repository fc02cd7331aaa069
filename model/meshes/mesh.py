"""The triangle mesh that every part of the package works on."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from model._jit import jit, jit_allocating, kernel_array
from model.errors import DegenerateMeshError, EmptyMeshError, UnreadableMeshError
from model.geometry.edges import is_watertight
from model.meshes.texture import Texture
from model.types import AnyArray, ByteArray, FloatArray, IntArray

if TYPE_CHECKING:
    import trimesh

# Below this share of the squared bounding-box diagonal, area is rounding noise of points on a line.
_SMALLEST_AREA = 1e-14
# Squares and products of lengths beyond these leave the range of float64.
LARGEST_COORDINATE = 1e60
"""Of a coordinate that faces use."""

_SMALLEST_EXTENT = 1e-60


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles in the input frame: the file's own coordinates, scene transforms applied.

    Open, non-manifold and self-intersecting surfaces, several bodies, duplicated faces and faces without area are all
    legal. Vertices that no face uses are legal too and ignored by everything geometric.

    Attributes:
        vertices: (v, 3) float64, C-contiguous.
        faces: (f, 3) int32, C-contiguous.
        source_format: one of ``model.formats.FORMATS``, or None if it came from memory.
        units: length unit named by the file, if it names one.
        warnings: what was left out or guessed when the file was read, a sentence each.
        colors: (v, 4) uint8, red, green, blue (sRGB) and opacity of the vertices, if the file has any.
        texture: pictures on the surface, if they were asked for and are at hand.
        painted: whether materials of the file that were not read give it several colours or pictures.
        kind: ``points`` where the file holds a point cloud: the vertices are its points, without outliers and thinned
            where there are very many, and the faces triangles between neighbours (`model.meshes.points`).
    """

    vertices: FloatArray
    faces: IntArray
    source_format: str | None = None
    units: str | None = None
    warnings: tuple[str, ...] = ()
    colors: ByteArray | None = None
    kind: Literal["mesh", "points"] = "mesh"
    texture: Texture | None = None
    painted: bool = False

    @classmethod
    def checked(
        cls,
        vertices: ArrayLike,
        faces: ArrayLike,
        *,
        source_format: str | None = None,
        units: str | None = None,
        warnings: tuple[str, ...] = (),
        colors: ByteArray | None = None,
        kind: Literal["mesh", "points"] = "mesh",
        texture: Texture | None = None,
        painted: bool = False,
    ) -> "Mesh":
        """A mesh that all computations can rely on.

        Raises:
            EmptyMeshError: there are no faces.
            DegenerateMeshError: a used coordinate is NaN, infinite or beyond 1e60, an index is out of range, or the
                surface has no extent or no area.
            UnreadableMeshError: the arrays are not (v, 3) numbers and (f, 3) integers.
        """
        points, triangles = _as_arrays(vertices, faces)
        if colors is not None and (colors.shape != (len(points), 4) or colors.dtype != np.uint8):
            raise UnreadableMeshError("Colours must be (v, 4) numbers of 8 bits.")
        if texture is not None and (len(texture.places), len(texture.of_face)) != (len(points), len(triangles)):
            raise UnreadableMeshError("A texture must tell of every vertex and of every face.")
        if triangles.shape[0] == 0:
            raise EmptyMeshError("The mesh has no faces.")
        if triangles.min() < 0 or triangles.max() >= points.shape[0]:
            raise DegenerateMeshError("A face refers to a vertex that does not exist.")
        mesh = cls(
            points, kernel_array(triangles, np.int32), source_format, units, warnings, colors, kind, texture, painted
        )
        low, high = mesh.bounds
        if not (np.isfinite(low).all() and np.isfinite(high).all()):
            raise DegenerateMeshError("The mesh has coordinates that are not finite numbers.")
        if max(-low.min(), high.max()) > LARGEST_COORDINATE:
            raise DegenerateMeshError("The mesh has coordinates beyond 1e60.")
        diagonal = float(np.linalg.norm(high - low))
        if diagonal < _SMALLEST_EXTENT:
            raise DegenerateMeshError("All points of the mesh coincide; it has no extent.")
        if not mesh.area > _SMALLEST_AREA * diagonal**2:
            raise DegenerateMeshError("The mesh has no surface area.")
        return mesh

    @property
    def bounds(self) -> FloatArray:
        """(2, 3) float64, lowest and highest corner of the surface; NaN if any coordinate of it is NaN."""
        return _bounds(self.vertices, self.faces)

    @property
    def area(self) -> float:
        """Surface area in squared input units, duplicated faces counted each time."""
        return float(_total_area(self.vertices, self.faces))

    @property
    def watertight(self) -> bool:
        """Whether every edge belongs to exactly two faces once vertices at identical positions are merged."""
        return is_watertight(self.vertices, self.faces)

    def to_trimesh(self) -> "trimesh.Trimesh":
        """A ``trimesh.Trimesh`` with copies of the same vertices and faces, none merged, removed or reordered.

        The matrices of results fit its ``apply_transform``; ``model.formats.conversion.as_mesh`` is the way back.
        """
        import trimesh  # here: it takes a third of a second, and only those who hold its objects need it

        mesh = trimesh.Trimesh(self.vertices.copy(), self.faces.copy(), process=False)
        if self.units is not None:
            mesh.units = self.units
        return mesh


def _as_arrays(vertices: ArrayLike, faces: ArrayLike) -> tuple[FloatArray, AnyArray]:
    try:
        points = kernel_array(vertices, np.float64)
        triangles = np.asarray(faces)
    except (TypeError, ValueError) as error:
        raise UnreadableMeshError("Vertices and faces must be arrays of numbers.") from error
    if triangles.size == 0:
        triangles = np.empty((0, 3), dtype=np.int32)
    if points.size == 0:
        points = np.empty((0, 3))
    if points.ndim != 2 or points.shape[1] != 3 or triangles.ndim != 2 or triangles.shape[1] != 3:
        raise UnreadableMeshError("Vertices must have shape (v, 3) and faces (f, 3).")
    if triangles.dtype.kind not in "iu":
        raise UnreadableMeshError("Faces must be integers.")
    return points, triangles


@jit_allocating
def _bounds(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """Corners of the box around the vertices that faces use."""
    used = np.zeros(vertices.shape[0], dtype=np.uint8)
    for face in range(faces.shape[0]):
        used[faces[face, 0]] = 1
        used[faces[face, 1]] = 1
        used[faces[face, 2]] = 1
    result = np.empty((2, 3))
    result[0] = np.inf
    result[1] = -np.inf
    for vertex in range(vertices.shape[0]):
        if used[vertex]:
            for axis in range(3):
                value = vertices[vertex, axis]
                if not np.isfinite(value):
                    result[:] = np.nan
                    return result
                result[0, axis] = min(result[0, axis], value)
                result[1, axis] = max(result[1, axis], value)
    return result


@jit
def _total_area(vertices: FloatArray, faces: IntArray) -> float:
    """Sum of the triangles' areas."""
    total = 0.0
    for face in range(faces.shape[0]):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        px, py, pz = (
            vertices[b, 0] - vertices[a, 0],
            vertices[b, 1] - vertices[a, 1],
            vertices[b, 2] - vertices[a, 2],
        )
        qx, qy, qz = (
            vertices[c, 0] - vertices[a, 0],
            vertices[c, 1] - vertices[a, 1],
            vertices[c, 2] - vertices[a, 2],
        )
        x, y, z = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
        total += 0.5 * np.sqrt(x * x + y * y + z * z)
    return total
