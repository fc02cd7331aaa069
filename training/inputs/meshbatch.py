"""Many meshes of different size as one batch of tensors, and the exact geometry training needs of them.

Everything here is plain torch, so that `training fit` needs no mesh library and runs on any device. Meshes are
"ragged": the triangles of all shapes of a batch stand one after the other, and ``shape`` says whose each one is.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

VIEWS = 16
"""Directions from which `training views` looks at every shape: the bits of ``seen``."""


@dataclass
class MeshBatch:
    """Triangles of ``size`` shapes.

    ``corners`` is ``(t, 3, 3)`` float (triangle, corner, coordinate); ``shape`` is ``(t,)`` int64, ascending. ``seen``
    ``(t,)`` int32, where the shapes are cut into pieces, holds a bit for every direction a triangle is seen from; what
    is made of a batch is without it.
    """

    corners: Tensor
    shape: Tensor
    size: int
    seen: Tensor | None = None

    def moved(self, rotation: Tensor, center: Tensor, scale: Tensor) -> "MeshBatch":
        """``rotation (x - center) / scale`` for every shape; ``(b, 3, 3)``, ``(b, 3)``, ``(b,)``."""
        linear = rotation.mT / scale[:, None, None]
        shift = -(center[:, None] @ linear)
        parts = [torch.addmm(s, c, m) for c, m, s in zip(self._by_shape(self.corners), linear, shift, strict=True)]
        return MeshBatch(torch.cat(parts).view(-1, 3, 3), self.shape, self.size)

    def without(self, dropped: Tensor) -> "MeshBatch":
        """The same shapes without the triangles marked in ``dropped`` ``(t,)`` bool."""
        kept = ~dropped
        return MeshBatch(self.corners[kept], self.shape[kept], self.size)

    def part(self, which: slice) -> "MeshBatch":
        """Some neighbouring shapes of the batch."""
        first, last, _ = which.indices(self.size)
        inside = (self.shape >= first) & (self.shape < last)
        return MeshBatch(self.corners[inside], self.shape[inside] - first, last - first)

    @cached_property
    def areas(self) -> Tensor:
        """Triangle areas, ``(t,)``."""
        edges = self.corners[:, 1:] - self.corners[:, :1]
        return 0.5 * torch.linalg.cross(edges[:, 0], edges[:, 1]).norm(dim=-1)

    @cached_property
    def middles(self) -> Tensor:
        """Triangle centroids, ``(t, 3)``."""
        return (self.corners[:, 0] + self.corners[:, 1] + self.corners[:, 2]) / 3.0

    @cached_property
    def counts(self) -> Tensor:
        """Triangles of each shape, ``(b,)`` int64."""
        return torch.bincount(self.shape, minlength=self.size)

    def _by_shape(self, values: Tensor) -> Iterator[Tensor]:
        """Rows ``(n, 3)`` of ``values`` ``(t, ..., 3)``, shape by shape: a matrix product a shape is fast on a CPU."""
        rows = values.numel() // (3 * max(1, len(values)))
        return iter(values.reshape(-1, 3).split([rows * count for count in self.counts.tolist()]))

    def second_moments(self, center: Tensor) -> Tensor:
        """Integral of ``x x^T`` over the surface, x from ``center`` ``(b, 3)``: ``(b, 3, 3)``, exact."""
        # Over a triangle it is area / 12 (sum of v v^T over its corners + 9 m m^T).
        weights = self.areas.split(self.counts.tolist())
        triangles = zip(self._by_shape(self.corners), self._by_shape(self.middles), weights, center, strict=True)
        parts: list[Tensor] = []
        for corners, middles, areas, origin in triangles:
            corners, middles = corners - origin, middles - origin
            of_corners = (corners * areas.repeat_interleave(3)[:, None]).mT @ corners
            parts.append((of_corners + 9.0 * (middles * areas[:, None]).mT @ middles) / 12.0)
        return torch.stack(parts)

    def per_shape(self, values: Tensor) -> Tensor:
        """Sum ``(t, ...)`` values over the triangles of each shape: ``(b, ...)``."""
        return values.new_zeros((self.size, *values.shape[1:])).index_add_(0, self.shape, values)


def gather(
    vertices: Tensor,
    faces: Tensor,
    vertex_start: Tensor,
    face_start: Tensor,
    shapes: Tensor,
    seen: Tensor | None = None,
) -> MeshBatch:
    """Take ``shapes`` ``(b,)`` out of flat storage.

    Args:
        vertices: ``(V, 3)`` float, all shapes one after the other.
        faces: ``(F, 3)`` integer, indices counted within each shape.
        vertex_start: ``(n + 1,)`` int64; shape i owns rows ``vertex_start[i]:vertex_start[i + 1]``.
        face_start: likewise for the faces.
        shapes: which shapes, int64.
        seen: ``(F,)`` int32, see `MeshBatch`.
    """
    counts = face_start[shapes + 1] - face_start[shapes]
    shape = torch.repeat_interleave(torch.arange(len(shapes), device=shapes.device), counts)
    ends = counts.cumsum(0)
    within = torch.arange(len(shape), device=shapes.device) - (ends - counts)[shape]
    place = face_start[shapes][shape] + within
    corners = vertices[faces[place].long() + vertex_start[shapes][shape, None]]
    return MeshBatch(corners, shape, len(shapes), None if seen is None else seen[place])


def unit_frames(batch: MeshBatch) -> tuple[Tensor, Tensor]:
    """The unit frame of each shape (design: frames): area centroid ``(b, 3)`` and scale ``(b,)``.

    The scale is twice the largest distance of a surface point from the centroid; on a triangle mesh that point is
    a corner.
    """
    total = batch.per_shape(batch.areas).clamp_min(1e-20)
    center = batch.per_shape(batch.areas[:, None] * batch.middles) / total[:, None]
    radius = (batch.corners - center[batch.shape, None]).norm(dim=-1).amax(1)
    largest = radius.new_zeros(batch.size).scatter_reduce_(0, batch.shape, radius, "amax")
    return center, 2.0 * largest.clamp_min(1e-12)


def covariances(batch: MeshBatch, center: Tensor) -> Tensor:
    """Covariance of the surface about ``center`` ``(b, 3)``, exact triangle integrals: ``(b, 3, 3)``."""
    return batch.second_moments(center) / batch.per_shape(batch.areas).clamp_min(1e-20)[:, None, None]


def sample_surfaces(batch: MeshBatch, count: int, generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Area-weighted uniform samples: points ``(b, count, 3)`` and the triangle each lies on ``(b, count)``."""
    areas = batch.areas.double()
    share = areas / batch.per_shape(areas)[batch.shape].clamp_min(1e-30)
    # One cumulative sum over the whole batch: shape i occupies the interval [i, i + 1].
    cumulative = share.cumsum(0)
    device = batch.corners.device
    draws = torch.rand((batch.size, count, 3), generator=generator, device=device, dtype=torch.float64)
    start = torch.arange(batch.size, device=device, dtype=torch.float64)[:, None]
    face = torch.searchsorted(cumulative, start + draws[..., 0].clamp(1e-9, 1 - 1e-9))
    face = face.clamp_max(len(areas) - 1)
    root = draws[..., 1].sqrt()
    weights = torch.stack([1 - root, root * (1 - draws[..., 2]), root * draws[..., 2]], dim=-1)
    points = torch.einsum("bnk,bnkc->bnc", weights.to(batch.corners.dtype), batch.corners[face])
    return points, face
