"""A prepared set as training draws from it: meshes, surface samples and closest-point grids by shape index."""

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from training.data.derive import DERIVED_SAMPLES, derive
from training.data.mapped import MappedArrays
from training.data.prepared import PIECES, PreparedSet, dequantise
from training.inputs.meshbatch import MeshBatch, gather

_CHUNK = 16
_SHARE_OF_GPU = 0.5
"""A set is kept on the GPU if it takes no more of its free memory than this."""


class ShapeStore:
    """All shapes of a prepared set, ready to be drawn in batches.

    On the CPU everything is read from memory-mapped files as it is drawn, so that a set need not fit into memory; on
    a GPU the set is kept in its memory where it fits. What is drawn does not depend on which. Samples or a grid
    resolution the set does not hold are derived at construction (`progress` is called with done and total).
    """

    def __init__(
        self,
        prepared: PreparedSet,
        device: torch.device,
        grid: int,
        progress: Callable[[int, int], None] | None = None,
        pieces: bool = False,
    ) -> None:
        """Open a set; with ``pieces`` its meshes come as `training views` cut them.

        Raises:
            ValueError: there are no pieces.
        """
        if pieces and prepared.views is None:
            raise ValueError(f"{prepared.root}, or a set mixed into it, has no views; run `training views` first")
        self.device = device
        self.grid = grid
        self.size = len(prepared)
        resident = device.type != "cpu" and _fits(prepared, device, grid, pieces)
        self._arrays = (ResidentArrays if resident else MappedArrays)(prepared, device, grid, progress, pieces)

    def meshes(self, shapes: Tensor) -> MeshBatch:
        """The triangles of ``shapes`` ``(b,)`` in the canonical (unit) frame."""
        return self._arrays.meshes(shapes)

    def draw_samples(self, shapes: Tensor, count: int, generator: torch.Generator) -> Tensor:
        """``count`` samples of each shape, ``(b, count, 3)``: a random window of those stored in random order."""
        stored = self._arrays.stored_samples
        first = torch.randint(0, stored, (len(shapes), 1), generator=generator, device=self.device)
        return self._arrays.samples(shapes, (first + torch.arange(count, device=self.device)) % stored)

    def closest(self, shapes: Tensor, points: Tensor) -> Tensor:
        """The grid's closest surface point for canonical ``points`` ``(b, m, 3)``: ``(b, m, 3)``.

        It belongs to the centre of the voxel a point falls into, and is a constant for the gradient (section 4.1).
        """
        cell = self._cells(points)
        return self._arrays.closest(shapes, (cell[..., 0] * self.grid + cell[..., 1]) * self.grid + cell[..., 2])

    def occupied(self, points: Tensor, closest: Tensor) -> Tensor:
        """Whether each point's voxel holds surface, ``(b, m)``: its centre is closer than half a voxel's diagonal."""
        centre = (self._cells(points) + 0.5) / self.grid - 0.5
        return (closest - centre).square().sum(-1) <= 0.75 / self.grid**2

    def _cells(self, points: Tensor) -> Tensor:
        return ((points + 0.5) * self.grid).long().clamp_(0, self.grid - 1)


class ResidentArrays:
    """The arrays of a prepared set in the memory of a device; the same methods as `MappedArrays`."""

    def __init__(
        self,
        prepared: PreparedSet,
        device: torch.device,
        grid: int,
        progress: Callable[[int, int], None] | None,
        pieces: bool = False,
    ) -> None:
        """Load everything; ``progress`` is called with done and total while something is derived."""
        self._grid = grid
        kind = PIECES if pieces else ""
        shift = np.zeros(2, dtype=np.int64)
        rows = [np.zeros((1, 2), dtype=np.int64)]
        for part in prepared.arrays(f"{kind}starts"):
            rows.append(part[1:] + shift)
            shift = shift + part[-1]
        joined = torch.from_numpy(np.concatenate(rows)).to(device)
        self._vertex_start, self._face_start = joined[:, 0].contiguous(), joined[:, 1].contiguous()
        vertices = np.concatenate([dequantise(part) for part in prepared.arrays(f"{kind}vertices")])
        self._vertices = torch.from_numpy(vertices).to(device)
        self._faces = torch.from_numpy(np.concatenate(prepared.arrays(f"{kind}faces"))).to(device)
        self._seen = None
        if pieces:
            bits = np.concatenate(prepared.arrays(f"{PIECES}seen")).astype(np.int32)
            self._seen = torch.from_numpy(bits).to(device)
        if prepared.exact(grid):
            samples = prepared.arrays("samples")
            least = min(part.shape[1] for part in samples)
            self._samples = _signed(np.concatenate([part[:, :least] for part in samples])).to(device)
            self._closest = _signed(np.concatenate(prepared.arrays("closest"))).to(device)
        else:
            self._derive(len(prepared), device, progress)
        self.stored_samples = self._samples.shape[1]

    def meshes(self, shapes: Tensor) -> MeshBatch:
        """The triangles of ``shapes`` ``(b,)`` in the canonical frame."""
        return gather(self._vertices, self._faces, self._vertex_start, self._face_start, shapes, self._seen)

    def samples(self, shapes: Tensor, window: Tensor) -> Tensor:
        """The stored samples ``window`` ``(b, count)`` of ``shapes`` ``(b,)``: ``(b, count, 3)``."""
        return _coordinates(self._samples[shapes[:, None], window])

    def closest(self, shapes: Tensor, cells: Tensor) -> Tensor:
        """The grid's closest point of ``cells`` ``(b, m)``, flat indices, in ``shapes`` ``(b,)``: ``(b, m, 3)``."""
        return _coordinates(self._closest.view(-1, 3)[shapes[:, None] * self._grid**3 + cells])

    def _derive(self, size: int, device: torch.device, progress: Callable[[int, int], None] | None) -> None:
        generator = torch.Generator(device).manual_seed(0)
        self._samples = torch.empty((size, DERIVED_SAMPLES, 3), dtype=torch.int16, device=device)
        self._closest = torch.empty((size, self._grid**3, 3), dtype=torch.int16, device=device)
        for first in range(0, size, _CHUNK):
            shapes = torch.arange(first, min(first + _CHUNK, size), device=device)
            points, nearest = derive(self.meshes(shapes), self._grid, generator)
            self._samples[shapes], self._closest[shapes] = _to_signed(points), _to_signed(nearest)
            if progress is not None:
                progress(int(shapes[-1]) + 1, size)


def _fits(prepared: PreparedSet, device: torch.device, grid: int, pieces: bool) -> bool:
    """Whether the set's arrays take at most `_SHARE_OF_GPU` of the memory that is free on a GPU."""
    if device.type != "cuda":
        return True
    vertices = sum(shape.vertices for shape in prepared.shapes)
    faces = sum(shape.faces for shape in prepared.shapes)
    if pieces:
        faces = sum(len(part) for part in prepared.arrays(f"{PIECES}faces"))
        vertices = sum(len(part) for part in prepared.arrays(f"{PIECES}vertices")) + faces // 3
    taken = 12 * (vertices + faces) + 6 * len(prepared) * (grid**3 + DERIVED_SAMPLES)
    return taken <= _SHARE_OF_GPU * torch.cuda.mem_get_info(device)[0]


# torch has little arithmetic for uint16, so coordinates are kept shifted into int16.


def _signed(points: NDArray[np.uint16]) -> Tensor:
    return torch.from_numpy((points ^ np.uint16(0x8000)).view(np.int16))


def _to_signed(points: Tensor) -> Tensor:
    return (((points + 0.5) * 65535).round() - 32768).clamp(-32768, 32767).to(torch.int16)


def _coordinates(points: Tensor) -> Tensor:
    return (points.float() + 32768) / 65535 - 0.5
