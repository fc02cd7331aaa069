"""A prepared set on the training device: meshes, surface samples and closest-point grids by shape index."""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from training.closest_grid import flood_closest
from training.meshbatch import MeshBatch, gather, sample_surfaces
from training.prepared import PreparedSet, dequantise

DERIVED_SAMPLES = 4096
_DENSE = 16384
"""Samples a derived grid is flooded from; only the first `DERIVED_SAMPLES` are kept."""
_CHUNK = 16


class ShapeStore:
    """All shapes of a prepared set, ready to be drawn in batches.

    Meshes and samples live on ``device``. Closest-point grids do so on a GPU; on the CPU exact grids stay
    memory-mapped, so that a set need not fit into memory. Samples or a grid resolution the set does not hold are
    derived at construction (`progress` is called with done and total).
    """

    def __init__(
        self,
        prepared: PreparedSet,
        device: torch.device,
        grid: int,
        progress: Callable[[int, int], None] | None = None,
    ) -> None:
        self.device = device
        self.grid = grid
        starts = [np.asarray(part) for part in prepared.arrays("starts")]
        shift = np.zeros(2, dtype=np.int64)
        rows = [np.zeros((1, 2), dtype=np.int64)]
        for part in starts:
            rows.append(part[1:] + shift)
            shift = shift + part[-1]
        joined = torch.from_numpy(np.concatenate(rows)).to(device)
        self.vertex_start, self.face_start = joined[:, 0].contiguous(), joined[:, 1].contiguous()
        vertices = np.concatenate([dequantise(part) for part in prepared.arrays("vertices")])
        self.vertices = torch.from_numpy(vertices).to(device)
        self.faces = torch.from_numpy(np.concatenate(prepared.arrays("faces"))).to(device)
        self.size = len(prepared)
        exact = prepared.has("closest") and prepared.manifest["resolution"] == grid and prepared.has("samples")
        self._mapped: list[NDArray[Any]] | None = None
        if exact:
            self.samples = _signed(np.concatenate(prepared.arrays("samples"))).to(device)
            if device.type == "cpu":
                self._mapped = prepared.arrays("closest")
                lengths = [len(part) for part in self._mapped]
                self._shard_of = np.repeat(np.arange(len(lengths)), lengths)
                self._row_of = np.concatenate([np.arange(length) for length in lengths])
            else:
                self._closest = _signed(np.concatenate(prepared.arrays("closest"))).to(device)
        else:
            self._derive(progress)

    def meshes(self, shapes: Tensor) -> MeshBatch:
        """The triangles of ``shapes`` ``(b,)`` in the canonical (unit) frame."""
        return gather(self.vertices, self.faces, self.vertex_start, self.face_start, shapes)

    def draw_samples(self, shapes: Tensor, count: int, generator: torch.Generator) -> Tensor:
        """``count`` samples of each shape, ``(b, count, 3)``: a random window of those stored in random order."""
        stored = self.samples.shape[1]
        first = torch.randint(0, stored, (len(shapes), 1), generator=generator, device=self.device)
        window = (first + torch.arange(count, device=self.device)) % stored
        return _coordinates(self.samples[shapes[:, None], window])

    def closest(self, shapes: Tensor, points: Tensor) -> Tensor:
        """The grid's closest surface point for canonical ``points`` ``(b, m, 3)``: ``(b, m, 3)``.

        It belongs to the centre of the voxel a point falls into, and is a constant for the gradient (section 4.1).
        """
        cell = self._cells(points)
        flat = (cell[..., 0] * self.grid + cell[..., 1]) * self.grid + cell[..., 2]
        if self._mapped is None:
            return _coordinates(self._closest.view(-1, 3)[shapes[:, None] * self.grid**3 + flat])
        found = np.empty((*flat.shape, 3), dtype=np.uint16)
        for row, (shape, index) in enumerate(zip(shapes.tolist(), flat.numpy(), strict=True)):
            np.take(
                self._mapped[self._shard_of[shape]][self._row_of[shape]], index, axis=0, out=found[row], mode="clip"
            )
        return torch.from_numpy(dequantise(found))

    def occupied(self, points: Tensor, closest: Tensor) -> Tensor:
        """Whether each point's voxel holds surface, ``(b, m)``: its centre is closer than half a voxel's diagonal."""
        centre = (self._cells(points) + 0.5) / self.grid - 0.5
        return (closest - centre).square().sum(-1) <= 0.75 / self.grid**2

    def _cells(self, points: Tensor) -> Tensor:
        return ((points + 0.5) * self.grid).long().clamp_(0, self.grid - 1)

    def _derive(self, progress: Callable[[int, int], None] | None) -> None:
        generator = torch.Generator(self.device).manual_seed(0)
        self.samples = torch.empty((self.size, DERIVED_SAMPLES, 3), dtype=torch.int16, device=self.device)
        self._closest = torch.empty((self.size, self.grid**3, 3), dtype=torch.int16, device=self.device)
        for first in range(0, self.size, _CHUNK):
            shapes = torch.arange(first, min(first + _CHUNK, self.size), device=self.device)
            points, _ = sample_surfaces(self.meshes(shapes), _DENSE, generator)
            self.samples[shapes] = _to_signed(points[:, :DERIVED_SAMPLES])
            self._closest[shapes] = _to_signed(flood_closest(points, self.grid))
            if progress is not None:
                progress(int(shapes[-1]) + 1, self.size)


# torch has little arithmetic for uint16, so coordinates are kept shifted into int16.


def _signed(points: NDArray[np.uint16]) -> Tensor:
    return torch.from_numpy((points ^ np.uint16(0x8000)).view(np.int16))


def _to_signed(points: Tensor) -> Tensor:
    return (((points + 0.5) * 65535).round() - 32768).clamp(-32768, 32767).to(torch.int16)


def _coordinates(points: Tensor) -> Tensor:
    return (points.float() + 32768) / 65535 - 0.5
