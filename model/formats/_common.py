"""What all readers share: their result, the size limits, polygons to triangles."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from model._jit import jit, kernel_array
from model.errors import MeshTooLargeError, UnreadableMeshError
from model.types import AnyArray, FloatArray, IntArray

MOST_NODES = 1 << 20
"""Nodes, objects and placements of a scene, unless the caller says otherwise."""

MOST_UNPACKED_BYTES = 1 << 30
"""Bytes that the parts of an archive unpack to, unless the caller says otherwise."""


@dataclass(frozen=True, slots=True)
class RawMesh:
    """What a file holds, not yet checked: (v, 3) vertices, (f, 3) faces, and the file's length unit if it names one."""

    vertices: AnyArray
    faces: AnyArray
    units: str | None = None


@dataclass(frozen=True, slots=True)
class Limits:
    """The largest file the caller accepts, by what is in it; None means any."""

    max_vertices: int | None = None
    max_faces: int | None = None
    max_nodes: int = MOST_NODES
    max_unpacked_bytes: int = MOST_UNPACKED_BYTES

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
            length of the content before it allocates.
        recognize: whether content is certainly of this format, whatever its file is named.
    """

    read: Callable[[bytes, Limits], RawMesh]
    recognize: Callable[[bytes], bool]


def no_faces() -> IntArray:
    """(0, 3) int32."""
    return np.empty((0, 3), dtype=np.int32)


def fan(indices: AnyArray, lengths: AnyArray, limits: Limits) -> IntArray:
    """Triangles (f, 3) of polygons, each as a fan around its first corner.

    Args:
        indices: corners of all polygons in a row, any number type.
        lengths: corners of each; those with fewer than three have no triangle.
        limits: checked before the triangles are made.

    Raises:
        UnreadableMeshError: an index does not fit into 32 bits.
    """
    lengths = kernel_array(lengths, np.int64)
    faces = int(np.maximum(lengths - 2, 0).sum())
    limits.check(faces=faces)
    corners = as_indices(indices)
    if len(lengths) and (lengths == 3).all():
        return corners.reshape(-1, 3)
    result = np.empty((faces, 3), dtype=np.int32)
    _fan(corners, lengths, result)
    return result


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


@jit
def _fan(corners: IntArray, lengths: AnyArray, result: IntArray) -> None:
    start, face = 0, 0
    for polygon in range(lengths.shape[0]):
        for corner in range(2, lengths[polygon]):
            result[face, 0] = corners[start]
            result[face, 1] = corners[start + corner - 1]
            result[face, 2] = corners[start + corner]
            face += 1
        start += lengths[polygon]


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
