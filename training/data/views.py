"""`training views`: which parts of every shape of a prepared set a scanner sees from several sides.

A recipe that shows one-sided scans (``damage.scans``) takes them from here; rendering depth images while training would
cost more than training itself. Every shape is cut into small pieces, triangles of edges up to `LONGEST_EDGE`, and seen
from `VIEWS` random directions. Files beside those of the set:

PREPARED/
  views.json             counts and a sha256 over all pieces
  shard-00000/
    piece_vertices.npy   (V, 3) uint16, unit frame, as `vertices.npy`
    piece_faces.npy      (F, 3) int32, as `faces.npy`
    piece_starts.npy     (n + 1, 2) int64, as `starts.npy`
    piece_seen.npy       (F,) uint16, bit k: the piece is seen from the shape's direction k
"""

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from model.errors import PRSNetError
from model.geometry.sampling import sample_surface
from model.meshes.subdivision import subdivide
from model.types import FloatArray, IntArray
from training.data.prepared import PIECES, PreparedSet, dequantise, mesh_at, quantise
from training.inputs.depth import seen_from
from training.inputs.meshbatch import VIEWS
from training.parallel import spread

LONGEST_EDGE = 0.06
"""Unit frame: two voxels. A piece is seen or hidden as a whole."""

_PIXELS = 64
_CLOUD = 4 * _PIXELS * _PIXELS
"""Points of the surface that hide others."""


@dataclass(frozen=True, slots=True)
class Summary:
    """Shapes of the set, and their pieces."""

    shapes: int
    pieces: int


@dataclass(frozen=True, slots=True)
class _Job:
    shard: Path
    first: int
    shapes: int
    set_sha256: str


def render_views(prepared: PreparedSet, workers: int = 1, progress: bool = True) -> Summary:
    """Cut and render every shape of a prepared set; an interrupted run is resumed.

    Args:
        prepared: the set; its folder is written to.
        workers: processes.
        progress: whether a bar is shown.
    """
    jobs: list[_Job] = []
    first = 0
    for shard, entry in zip(prepared.shards, prepared.manifest["shards"], strict=True):
        jobs.append(_Job(shard, first, entry["shapes"], prepared.sha256))
        first += entry["shapes"]
    records: list[dict[str, Any]] = []
    with tqdm(total=len(prepared), unit="shape", disable=not progress) as bar:
        for job, record in zip(jobs, spread(_render_shard, jobs, workers), strict=True):
            records.append(record)
            bar.update(job.shapes)
    pieces = sum(record["pieces"] for record in records)
    digest = hashlib.sha256("".join(record["sha256"] for record in records).encode()).hexdigest()
    document = {"set": prepared.sha256, "views": VIEWS, "pieces": pieces, "sha256": digest}
    (prepared.root / "views.json").write_text(json.dumps(document, indent=1))
    return Summary(len(prepared), pieces)


def _render_shard(job: _Job) -> dict[str, Any]:
    """Write one shard's pieces, or return the record of those already there. The record is written last."""
    record_file = job.shard / "views.json"
    if record_file.is_file():
        record = json.loads(record_file.read_text())
        if record["set"] == job.set_sha256:
            return record
        record_file.unlink()
    arrays = {name: np.load(job.shard / f"{name}.npy", mmap_mode="r") for name in ("vertices", "faces", "starts")}
    columns: dict[str, list[NDArray[Any]]] = {"vertices": [], "faces": [], "seen": []}
    starts = [(0, 0)]
    for index in range(job.shapes):
        vertices, faces, seen = pieces_of(*mesh_at(arrays, index), seed=job.first + index)
        starts.append((starts[-1][0] + len(vertices), starts[-1][1] + len(faces)))
        for name, column in (("vertices", quantise(vertices)), ("faces", faces), ("seen", seen)):
            columns[name].append(column)
    written: dict[str, NDArray[Any]] = {name: np.concatenate(parts) for name, parts in columns.items()}
    written["starts"] = np.array(starts, dtype=np.int64)
    digest = hashlib.sha256()
    for name in sorted(written):
        np.save(job.shard / f"{PIECES}{name}.npy", written[name])
        digest.update(name.encode() + written[name].tobytes())
    record = {"set": job.set_sha256, "pieces": len(written["faces"]), "sha256": digest.hexdigest()}
    record_file.write_text(json.dumps(record))
    return record


def pieces_of(vertices: FloatArray, faces: IntArray, seed: int) -> tuple[FloatArray, IntArray, NDArray[np.uint16]]:
    """A surface cut into pieces, and from which of `VIEWS` random directions each of them is seen.

    Args:
        vertices: ``(v, 3)``, unit frame.
        faces: ``(f, 3)``.
        seed: the directions follow from it.

    Returns:
        vertices ``(w, 3)`` and faces ``(g, 3)`` of the pieces, and ``(g,)``, bit k for direction k.
    """
    vertices, faces = subdivide(vertices, faces, LONGEST_EDGE)
    # What the pieces will be read back as: a vertex moves by up to half a step of the quantisation.
    vertices = dequantise(quantise(vertices)).astype(np.float64)
    middle = vertices[faces].mean(1)
    seen = np.zeros(len(faces), dtype=np.uint16)
    try:
        cloud = np.concatenate([sample_surface(vertices, faces, _CLOUD, seed=0)[0], middle])
    except PRSNetError:  # quantised to nothing
        return vertices, faces, ~seen
    directions = np.random.default_rng(seed).normal(size=(VIEWS, 3))
    for view, direction in enumerate(directions / np.linalg.norm(directions, axis=1, keepdims=True)):
        # The shape lies in a ball of diameter 1, in whichever direction the image is taken.
        hit = seen_from(cloud, middle, direction, 1.0 / _PIXELS)
        seen |= hit.astype(np.uint16) << np.uint16(view)
    return vertices, faces, seen
