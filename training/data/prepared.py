"""Prepared sets on disk, read with numpy alone: what `training prepare` writes and `training fit` trains on.

    PREPARED/
      manifest.json          version, resolution, samples, counts, and a sha256 over all shards
      shapes.csv             one line a shape: name, source, category, vertices, faces, licence and split
                             where they are known, in shard order
      skipped.csv            what could not be read, and why
      shard-00000/
        vertices.npy         (V, 3) uint16, unit frame, all shapes one after the other
        faces.npy            (F, 3) int32, indices within each shape
        starts.npy           (n + 1, 2) int64, where each shape's vertices and faces begin
        samples.npy          (n, S, 3) uint16, area-weighted uniform surface samples in random order
        voxels.npy           (n, R^3 / 8) uint8, the unit frame's voxels, bits packed
        closest.npy          (n, R^3, 3) uint16, exact closest surface point to each voxel centre

Samples, voxels and closest points are absent from a set prepared with `--mesh-only`; `fit` then derives what it needs.
"""

import csv
import hashlib
import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

FORMAT_VERSION = 1
PIECES = "piece_"
"""What the names of a set's arrays begin with that hold its shapes cut into pieces (`training views`)."""

_LEVELS = 65535


def quantise(points: NDArray[Any]) -> NDArray[np.uint16]:
    """Unit-frame coordinates in [-0.5, 0.5] as 16-bit integers; a step is 1.5e-5."""
    return np.round((np.clip(points, -0.5, 0.5) + 0.5) * _LEVELS).astype(np.uint16)


def dequantise(points: NDArray[np.uint16]) -> NDArray[np.float32]:
    """The inverse of `quantise`, float32."""
    return (points.astype(np.float32) / _LEVELS - 0.5).astype(np.float32)


def mesh_at(arrays: Mapping[str, NDArray[Any]], row: int) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Vertices ``(v, 3)``, unit frame, and faces ``(f, 3)`` of one shape, out of its shard's arrays by name."""
    (v0, f0), (v1, f1) = arrays["starts"][row], arrays["starts"][row + 1]
    vertices = dequantise(arrays["vertices"][v0:v1]).astype(np.float64)
    return vertices, np.ascontiguousarray(arrays["faces"][f0:f1])


@dataclass(frozen=True, slots=True)
class ShapeRecord:
    """One line of shapes.csv."""

    name: str
    source: str
    category: str
    vertices: int
    faces: int
    licence: str = ""
    split: str = ""


class PreparedSet:
    """A prepared set, its arrays memory-mapped.

    Raises:
        ValueError: the folder holds no prepared set, or one of another version.
    """

    def __init__(self, root: str | Path) -> None:
        self.root = Path(root)
        manifest = self.root / "manifest.json"
        if not manifest.is_file():
            raise ValueError(f"{self.root} holds no prepared set (no manifest.json); run `training prepare` first")
        self.manifest: dict[str, Any] = json.loads(manifest.read_text())
        if self.manifest.get("version") != FORMAT_VERSION:
            raise ValueError(f"{self.root} was prepared by another version of this program; prepare it again")
        with (self.root / "shapes.csv").open(newline="") as lines:
            self.shapes = [_record(row) for row in csv.DictReader(lines)]

    def __len__(self) -> int:
        return len(self.shapes)

    @property
    def sha256(self) -> str:
        """The data manifest hash: names and content of every shard."""
        return str(self.manifest["sha256"])

    def record(self) -> dict[str, Any]:
        """What a run and shipped weights say of their data; licences, with the number of shapes, where known."""
        counts = Counter(shape.licence for shape in self.shapes if shape.licence)
        known = {"licences": dict(counts.most_common())} if counts else {}
        return {"manifest_sha256": self.sha256, "shapes": len(self), "skipped": self.manifest["skipped"], **known}

    @cached_property
    def labels(self) -> dict[str, Any] | None:
        """What `training label` wrote: method, counts and ``sha256``; None where the set has no labels."""
        record = self.root / "labels.json"
        labels = json.loads(record.read_text()) if record.is_file() else None
        return labels if labels is not None and labels["set"] == self.sha256 else None

    @cached_property
    def views(self) -> dict[str, Any] | None:
        """What `training views` wrote: counts and ``sha256``; None where the set has none."""
        record = self.root / "views.json"
        views = json.loads(record.read_text()) if record.is_file() else None
        return views if views is not None and views["set"] == self.sha256 else None

    @cached_property
    def shards(self) -> list[Path]:
        """The shard folders in order."""
        return [self.root / shard["name"] for shard in self.manifest["shards"]]

    def has(self, name: str) -> bool:
        """Whether every shard holds the array ``name``."""
        return all((shard / f"{name}.npy").is_file() for shard in self.shards)

    def exact(self, grid: int) -> bool:
        """Whether the set holds samples, and closest points for a grid of this resolution."""
        return self.has("closest") and self.has("samples") and self.manifest["resolution"] == grid

    def arrays(self, name: str) -> list[NDArray[Any]]:
        """The array ``name`` of every shard, memory-mapped."""
        return [np.load(shard / f"{name}.npy", mmap_mode="r") for shard in self.shards]

    def locations(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Where every shape is stored, ``(n,)`` each: the index of its shard, and its row in it."""
        lengths = [int(shard["shapes"]) for shard in self.manifest["shards"]]
        return np.repeat(np.arange(len(lengths)), lengths), np.concatenate([np.arange(length) for length in lengths])

    def split(self, validation_share: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Indices for training and for validation. A shape's side depends on its name alone, so it never changes."""
        limit = int(validation_share * 2**32)
        held_out = np.array([_name_hash(shape.name) < limit for shape in self.shapes], dtype=bool)
        return np.flatnonzero(~held_out), np.flatnonzero(held_out)


def _record(row: dict[str, str]) -> ShapeRecord:
    known = row["name"], row["source"], row["category"], int(row["vertices"]), int(row["faces"])
    return ShapeRecord(*known, row.get("licence", ""), row.get("split", ""))


def _name_hash(name: str) -> int:
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:4], "big")
