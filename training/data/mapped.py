"""A prepared set read from its files as it is drawn: memory-mapped, so that it need not fit into memory."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from training.data.derive import DERIVED_SAMPLES, derive
from training.data.prepared import PIECES, PreparedSet, dequantise, quantise
from training.inputs.meshbatch import MeshBatch

_CHUNK = 16
_SPARE_FILES = 256


class MappedArrays:
    """Meshes, samples and closest-point grids of a prepared set on disk.

    Samples or a grid of a resolution that the set does not hold are derived once, into the folder ``derived-R`` of the
    set, where the next run finds them, each shard under its name and hash.
    """

    def __init__(
        self,
        prepared: PreparedSet,
        device: torch.device,
        grid: int,
        progress: Callable[[int, int], None] | None,
        pieces: bool = False,
    ) -> None:
        """Map the files; ``progress`` is called with done and total while something is derived.

        With ``pieces`` meshes are read as `training views` cut them.
        """
        self._device = device
        self._shard_of, self._row_of = prepared.locations()
        _allow_files(6 * len(prepared.manifest["shards"]))
        kind = PIECES if pieces else ""
        self._vertices, self._faces, self._starts = (
            _open(prepared, kind + name) for name in ("vertices", "faces", "starts")
        )
        self._seen = _open(prepared, f"{PIECES}seen") if pieces else None
        if prepared.exact(grid):
            self._samples, self._closest = _open(prepared, "samples"), _open(prepared, "closest")
        else:
            self._samples, self._closest = self._derived(prepared, grid, progress)
        self.stored_samples = min(part.shape[1] for part in self._samples)

    def meshes(self, shapes: Tensor) -> MeshBatch:
        """The triangles of ``shapes`` ``(b,)`` in the canonical frame."""
        corners: list[NDArray[np.uint16]] = []
        seen: list[NDArray[np.uint16]] = []
        for shard, row in self._locations(shapes):
            (v0, f0), (v1, f1) = self._starts[shard][row : row + 2].tolist()
            corners.append(self._vertices[shard][v0:v1][self._faces[shard][f0:f1]])
            if self._seen is not None:
                seen.append(self._seen[shard][f0:f1])
        counts = torch.tensor([len(part) for part in corners])
        shape = torch.repeat_interleave(torch.arange(len(corners)), counts)
        packed = torch.from_numpy(dequantise(np.concatenate(corners)))
        bits = torch.from_numpy(np.concatenate(seen).astype(np.int32)).to(self._device) if seen else None
        return MeshBatch(packed.to(self._device), shape.to(self._device), len(corners), bits)

    def samples(self, shapes: Tensor, window: Tensor) -> Tensor:
        """The stored samples ``window`` ``(b, count)`` of ``shapes`` ``(b,)``: ``(b, count, 3)``."""
        found = np.empty((*window.shape, 3), dtype=np.uint16)
        for out, (shard, row), index in zip(found, self._locations(shapes), window.cpu().numpy(), strict=True):
            np.take(self._samples[shard][row], index, axis=0, out=out, mode="clip")
        return torch.from_numpy(dequantise(found)).to(self._device)

    def closest(self, shapes: Tensor, cells: Tensor) -> Tensor:
        """The grid's closest point of ``cells`` ``(b, m)``, flat indices, in ``shapes`` ``(b,)``: ``(b, m, 3)``."""
        locations = self._locations(shapes)
        if cells.device.type != "cpu":  # the grids of a batch are small: look up where the cells are
            grids = np.stack([self._closest[shard][row] for shard, row in locations])
            rows = torch.from_numpy(grids.view(np.int16)).to(cells.device).int() & 0xFFFF
            return torch.gather(rows, 1, cells[..., None].expand(-1, -1, 3)) / 65535 - 0.5
        found = np.empty((*cells.shape, 3), dtype=np.uint16)
        for out, (shard, row), index in zip(found, locations, cells.numpy(), strict=True):
            np.take(self._closest[shard][row], index, axis=0, out=out, mode="clip")
        return torch.from_numpy(dequantise(found))

    def _locations(self, shapes: Tensor) -> list[tuple[int, int]]:
        index = shapes.cpu().numpy()
        return list(zip(self._shard_of[index].tolist(), self._row_of[index].tolist(), strict=True))

    def _derived(
        self, prepared: PreparedSet, grid: int, progress: Callable[[int, int], None] | None
    ) -> tuple[list[NDArray[Any]], list[NDArray[Any]]]:
        generator = torch.Generator(self._device)
        done = 0
        samples: list[NDArray[Any]] = []
        closest: list[NDArray[Any]] = []
        for number, shard in enumerate(prepared.shards):
            count = int((self._shard_of == number).sum())
            digest = prepared.manifest["shards"][number]["sha256"][:12]
            folder = shard.parent / f"derived-{grid}" / f"{shard.name}-{digest}"
            if not (folder / "closest.npy").is_file():
                folder.mkdir(parents=True, exist_ok=True)
                points = _create(folder / "samples.tmp", (count, DERIVED_SAMPLES, 3))
                nearest = _create(folder / "closest.tmp", (count, grid**3, 3))
                for first in range(0, count, _CHUNK):
                    rows = slice(first, min(first + _CHUNK, count))
                    # By shard and row, so that a derivation that was cut off ends the same.
                    generator.manual_seed(number * 1_000_003 + first)
                    batch = self.meshes(torch.arange(done + rows.start, done + rows.stop))
                    drawn, flooded = derive(batch, grid, generator)
                    points[rows], nearest[rows] = quantise(drawn.cpu().numpy()), quantise(flooded.cpu().numpy())
                    if progress is not None:
                        progress(done + rows.stop, len(prepared))
                for array, name in ((points, "samples"), (nearest, "closest")):
                    array.flush()
                    (folder / f"{name}.tmp").replace(folder / f"{name}.npy")
            done += count
            samples.append(_plain(np.load(folder / "samples.npy", mmap_mode="r")))
            closest.append(_plain(np.load(folder / "closest.npy", mmap_mode="r")))
        return samples, closest


def _open(prepared: PreparedSet, name: str) -> list[NDArray[Any]]:
    return [_plain(array) for array in prepared.arrays(name)]


def _plain(array: NDArray[Any]) -> NDArray[Any]:
    """The same memory without the subclass, whose slices cost several times as much."""
    return array.view(np.ndarray)


def _create(path: Path, shape: tuple[int, ...]) -> "np.memmap[Any, np.dtype[np.uint16]]":
    return np.lib.format.open_memmap(path, mode="w+", dtype=np.uint16, shape=shape)


def _allow_files(count: int) -> None:
    """Every mapped array keeps a file open; the usual limit of 1,024 is passed by sets of 50,000 shapes."""
    try:
        import resource
    except ImportError:  # Windows, which has no such limit
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    wanted = count + _SPARE_FILES
    if soft != resource.RLIM_INFINITY and soft < wanted:
        wanted = wanted if hard == resource.RLIM_INFINITY else min(wanted, hard)
        resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
