"""What all readers share: their result, the size limits, indices."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from model._jit import kernel_array
from model.errors import MeshTooLargeError, UnreadableMeshError
from model.meshes.texture import Texture
from model.types import AnyArray, ByteArray, FloatArray, IntArray

MOST_NODES = 1 << 20
"""Nodes, objects and placements of a scene, unless the caller says otherwise."""

MOST_UNPACKED_BYTES = 1 << 30
"""Bytes that the parts of an archive unpack to, unless the caller says otherwise."""


@dataclass(frozen=True, slots=True)
class RawMesh:
    """What a file holds, not yet checked.

    Attributes:
        vertices: (v, 3).
        faces: (f, 3).
        units: the file's length unit, if it names one.
        warnings: what was left out or guessed, as sentences that quote nothing of the file.
        colors: (v, 4) uint8 sRGB with opacity, if there are any.
        texture: pictures on the surface, if they were asked for and are at hand.
        painted: whether materials that were not asked for give it several colours or pictures.
    """

    vertices: AnyArray
    faces: AnyArray
    units: str | None = None
    warnings: tuple[str, ...] = ()
    colors: ByteArray | None = None
    texture: Texture | None = None
    painted: bool = False


Resources: TypeAlias = Callable[[str], bytes | None]
"""The content of a file by the name that another one calls it; None for one that is not there."""


def no_resources(name: str) -> None:
    """There are no other files."""
    return None


@dataclass(frozen=True, slots=True)
class Limits:
    """The largest file the caller accepts, by what is in it, None meaning any; and whether its looks are wanted.

    ``looks``: colours of materials and pictures are read too. Vertices where they meet then become several.
    """

    max_vertices: int | None = None
    max_faces: int | None = None
    max_nodes: int = MOST_NODES
    max_unpacked_bytes: int = MOST_UNPACKED_BYTES
    looks: bool = False

    def check(self, vertices: int = 0, faces: int = 0, nodes: int = 0) -> None:
        """Raise MeshTooLargeError if the counts, known or announced by a header, are beyond the limits."""
        if nodes > self.max_nodes:
            raise MeshTooLargeError(f"The file places more than {self.max_nodes} objects.")
        if self.max_vertices is not None and vertices > self.max_vertices:
            raise MeshTooLargeError(f"The mesh has more than {self.max_vertices} vertices.")
        if self.max_faces is not None and faces > self.max_faces:
            raise MeshTooLargeError(f"The mesh has more than {self.max_faces} faces.")


@dataclass(frozen=True, slots=True)
class Reader:
    """The reader of one format.

    Attributes:
        read: the content of a file as a mesh. Raises nothing but ``model.errors``, and checks counts against the
            length of the content before it allocates. Files that the content refers to are asked for, never opened.
        recognize: whether content is certainly of this format, whatever its file is named.
        may_be_text: whether numbers may be written out, with a decimal comma where a program got it wrong.
    """

    read: Callable[[bytes, Limits, Resources], RawMesh]
    recognize: Callable[[bytes], bool]
    may_be_text: bool = False


def alone(read: Callable[[bytes, Limits], RawMesh]) -> Callable[[bytes, Limits, Resources], RawMesh]:
    """The reader of a format that never refers to other files."""
    return lambda data, limits, resources: read(data, limits)


def no_faces() -> IntArray:
    """(0, 3) int32."""
    return np.empty((0, 3), dtype=np.int32)


def as_indices(values: AnyArray) -> IntArray:
    """Vertex indices as int32, whatever integer or float type they came in.

    Raises:
        UnreadableMeshError: a value is no integer of 32 bits.
    """
    if values.size and values.dtype != np.int32:
        low, high = values.min(), values.max()
        if not (low >= -(2**31) and high < 2**31):  # also refuses NaN
            raise UnreadableMeshError("A vertex index is no number of 32 bits.")
    return kernel_array(values.astype(np.int32, copy=False), np.int32)


def strip(indices: IntArray) -> IntArray:
    """Triangles (f, 3) of one triangle strip, orientation kept."""
    if len(indices) < 3:
        return no_faces()
    triangles = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1)
    triangles[1::2] = triangles[1::2, [1, 0, 2]]
    return triangles


def to_float64(columns: list[AnyArray]) -> FloatArray:
    """(v, 3) float64 from three columns."""
    result = np.empty((len(columns[0]), 3))
    for axis, column in enumerate(columns):
        result[:, axis] = column
    return result


def is_mirror(matrix: FloatArray) -> bool:
    """Whether a (3, 3) matrix turns right hands into left ones; False where it is not finite."""
    a, b, c = matrix
    with np.errstate(all="ignore"):
        return bool(a @ np.cross(b, c) < 0.0)
