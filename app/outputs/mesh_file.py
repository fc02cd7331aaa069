"""What the writers of mesh files share: the two halves of a file, and the checks of the one that a worker made."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from app.schemas import DetectResponse
from model.meshes.texture import Texture
from model.types import AnyArray, ByteArray, FloatArray, IntArray


class BodyError(Exception):
    """A body is not what its counts say."""


@dataclass(frozen=True, slots=True)
class Counts:
    """What a file holds: vertices, triangles, and the corners (2, 3) of the box around them."""

    vertices: int
    faces: int
    bounds: list[list[float]]


class Body(Protocol):
    """Writes geometry as bytes; colours and pictures where the format has them."""

    def __call__(
        self,
        vertices: FloatArray,
        faces: IntArray,
        bounds: list[list[float]],
        colors: ByteArray | None = None,
        texture: Texture | None = None,
        /,
    ) -> bytes:
        """Raises ``MeshError`` where it does not fit."""
        ...


@dataclass(frozen=True, slots=True)
class MeshWriter:
    """A format: ``head(counts, body) + body`` is a file.

    Attributes:
        body: geometry ``(v, 3)`` float64 and ``(f, 3)`` int32, colours ``(v, 4)`` uint8 and pictures if there are any
            and the format has them, as bytes.
        head: what stands before it. Raises `BodyError` when the body is not such a geometry: of another size, with
            numbers that are none, with indices out of range.
        size: bytes of the body without colours and pictures by the numbers of vertices and faces; the most there can be
            where ``varies``.
        varies: whether the size depends on the numbers themselves, as in a text.
        annotated_head: ``head`` for a file that shows the symmetries beside the mesh; None where the format cannot.
    """

    body: Body
    head: Callable[[Counts, bytes], bytes]
    size: Callable[[int, int], int]
    varies: bool = False
    annotated_head: Callable[[DetectResponse, bytes], bytes] | None = None

    def file(
        self,
        vertices: FloatArray,
        faces: IntArray,
        colors: ByteArray | None = None,
        texture: Texture | None = None,
    ) -> bytes:
        """The whole file."""
        bounds = bounds_of(vertices, faces)
        body = self.body(vertices, faces, bounds, colors, texture)
        return self.head(Counts(len(vertices), len(faces), bounds), body) + body


def bounds_of(vertices: FloatArray, faces: IntArray) -> list[list[float]]:
    """Lowest and highest corner of the vertices that faces use."""
    used = vertices[np.unique(faces)]
    return [used.min(axis=0).tolist(), used.max(axis=0).tolist()]


def require(holds: bool, otherwise: str) -> None:
    """Raise `BodyError` unless it holds."""
    if not holds:
        raise BodyError(otherwise)


def require_numbers(values: AnyArray) -> None:
    """Raise `BodyError` unless all are finite."""
    require(bool(np.isfinite(values).all()), "a coordinate that is not finite")


def require_indices(indices: AnyArray, vertices: int) -> None:
    """Raise `BodyError` unless all are indices of vertices."""
    if indices.size:
        require(int(indices.min()) >= 0 and int(indices.max()) < vertices, "an index out of range")
