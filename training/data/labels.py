"""`training label`: the planes of a classical method, written beside a prepared set for `fit` to learn from.

Files beside those of the set:

PREPARED/
  labels.json            method, counts and a sha256 over all labels
  shard-00000/
    planes.npy           (n, K, 5) float32, rows (n, d, error) in the unit frame, best first; error inf: no plane
    families.npy         (n, 6) float32, direction and point of a continuous axis, zero where there is none
"""

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from model.detector import Detector, use_one_thread
from model.errors import PRSNetError
from model.geometry.operations import Operations
from model.geometry.refinement import refine
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.search.candidates import distinct, mean_errors
from model.search.full import Sources
from model.types import FloatArray, IntArray
from training import baselines
from training.data.prepared import PreparedSet, mesh_at
from training.oracle.truth import Truth, load
from training.parallel import spread

METHODS = ("scan", "groundtruth", *baselines.NAMES)
_SAMPLES = 600


@dataclass(frozen=True, slots=True)
class Options:
    """How labels are made; shards labelled with the same options are kept.

    ``method``: ``scan`` is full mode without the network (a scan of directions and the inertia frame, refined on exact
    distances, completed to a group and judged); a name of `training.baselines.NAMES` refines the planes of that method
    alone; ``groundtruth`` takes what `training groundtruth` found. ``planes`` is K, ``max_error`` the largest symmetry
    error (SDE) of a label.
    """

    method: str = "scan"
    planes: int = 16
    max_error: float = 4e-4


@dataclass(frozen=True, slots=True)
class Labels:
    """Planes of one shape in its unit frame, ``(k, 4)`` with errors ``(k,)``, and its continuous ``axis`` ``(6,)``."""

    planes: FloatArray
    errors: FloatArray
    axis: FloatArray


@dataclass(frozen=True, slots=True)
class Summary:
    """Shapes of the set, how many of them have a label, and the number of planes and continuous axes."""

    shapes: int
    labelled: int
    planes: int
    axes: int


def label(
    prepared: PreparedSet, options: Options, truth: Path | None = None, workers: int = 1, progress: bool = True
) -> Summary:
    """Label every shape of a prepared set; an interrupted run is resumed.

    Args:
        prepared: the set; its folder is written to.
        options: method and limits.
        truth: for ``groundtruth``, the file; it names shapes as `training prepare` does.
        workers: processes.
        progress: whether a bar is shown.

    Raises:
        ValueError: there is no such method, or no truth where it is needed.
    """
    if options.method not in METHODS:
        raise ValueError(f"the method is one of {', '.join(METHODS)}, not {options.method!r}")
    if (truth is not None) != (options.method == "groundtruth"):
        raise ValueError("the method groundtruth needs the file that `training groundtruth` wrote, the others none")
    known = {} if truth is None else load(truth)
    stamp = {**asdict(options), "set": prepared.sha256}
    if truth is not None:
        stamp["truth"] = hashlib.sha256(truth.read_bytes()).hexdigest()
    jobs: list[_Job] = []
    first = 0
    for shard, entry in zip(prepared.shards, prepared.manifest["shards"], strict=True):
        names = [shape.name for shape in prepared.shapes[first : first + entry["shapes"]]]
        truths = None if truth is None else [known.get(name) for name in names]
        jobs.append(_Job(shard, len(names), truths, options, stamp))
        first += len(names)
    records: list[dict[str, Any]] = []
    with tqdm(total=len(prepared), unit="shape", disable=not progress) as bar:
        for job, record in zip(jobs, spread(_label_shard, jobs, workers), strict=True):
            records.append(record)
            bar.update(job.shapes)
    totals = {key: sum(record[key] for record in records) for key in ("labelled", "planes", "axes")}
    digest = hashlib.sha256("".join(record["sha256"] for record in records).encode()).hexdigest()
    document = {"options": asdict(options), "set": prepared.sha256, "shapes": len(prepared), **totals, "sha256": digest}
    (prepared.root / "labels.json").write_text(json.dumps(document, indent=1))
    return Summary(len(prepared), totals["labelled"], totals["planes"], totals["axes"])


@dataclass(frozen=True, slots=True)
class _Job:
    shard: Path
    shapes: int
    truths: list[Truth | None] | None
    options: Options
    stamp: dict[str, Any]


def _label_shard(job: _Job) -> dict[str, Any]:
    """Write one shard's labels, or return the record of those already there. The record is written last."""
    record_file = job.shard / "labels.json"
    if record_file.is_file():
        record = json.loads(record_file.read_text())
        if record["stamp"] == job.stamp:
            return record
        record_file.unlink()
    arrays = {name: np.load(job.shard / f"{name}.npy", mmap_mode="r") for name in ("vertices", "faces", "starts")}
    planes = np.full((job.shapes, job.options.planes, 5), np.inf, dtype=np.float32)
    planes[..., :4] = 0.0
    families = np.zeros((job.shapes, 6), dtype=np.float32)
    for index in range(job.shapes):
        vertices, faces = mesh_at(arrays, index)
        if job.truths is not None:
            found = _of_truth(job.truths[index])
        else:
            try:
                found = _found(job.options, vertices, faces)
            except PRSNetError:  # quantised to nothing
                continue
        good = np.flatnonzero(found.errors <= job.options.max_error)
        best = good[np.argsort(found.errors[good], kind="stable")][: job.options.planes]
        planes[index, : len(best), :4] = found.planes[best]
        planes[index, : len(best), 4] = found.errors[best]
        families[index] = found.axis
    np.save(job.shard / "planes.npy", planes)
    np.save(job.shard / "families.npy", families)
    there, axes = np.isfinite(planes[..., 4]), families[:, :3].any(1)
    record = {
        "stamp": job.stamp,
        "labelled": int((there.any(1) | axes).sum()),
        "planes": int(there.sum()),
        "axes": int(axes.sum()),
        "sha256": hashlib.sha256(planes.tobytes() + families.tobytes()).hexdigest(),
    }
    record_file.write_text(json.dumps(record))
    return record


def _found(options: Options, vertices: FloatArray, faces: IntArray) -> Labels:
    if options.method == "scan":
        return _scan(vertices, faces, options.max_error)
    return _baseline(options.method, vertices, faces, options.max_error)


def _scan(vertices: FloatArray, faces: IntArray, max_error: float) -> Labels:
    found = _detector().detect((vertices, faces), max_error=max_error, sources=Sources(network=False))
    planes = [plane for plane in found.planes if not plane.continuous]
    axes = [np.concatenate([axis.direction, axis.point]) for axis in found.axes if axis.continuous]
    return Labels(
        np.array([[*plane.normal, plane.offset] for plane in planes]).reshape(-1, 4),
        np.array([plane.symmetry_error for plane in planes]),
        _only(axes),
    )


@lru_cache(maxsize=1)
def _detector() -> Detector:
    use_one_thread()
    return Detector.load()


def _baseline(name: str, vertices: FloatArray, faces: IntArray, max_error: float) -> Labels:
    planes = baselines.load(name).find_planes(vertices, faces, np.random.default_rng(0))
    if not len(planes):
        return Labels(np.zeros((0, 4)), np.zeros(0), np.zeros(6))
    surface = SurfaceIndex(vertices, faces)
    samples, _ = sample_surface(vertices, faces, _SAMPLES, seed=0)
    refined = refine(surface, samples, Operations.reflections(planes))
    errors = mean_errors(surface, samples, refined)
    kept = [index for index in distinct(refined, errors) if errors[index] <= max_error]
    return Labels(refined.planes[kept], errors[kept], np.zeros(6))


def _of_truth(truth: Truth | None) -> Labels:
    if truth is None:
        return Labels(np.zeros((0, 4)), np.zeros(0), np.zeros(6))
    own = ~truth.plane_continuous
    axes = [np.concatenate([axis.direction, axis.point]) for axis in truth.axes if axis.order is None]
    return Labels(truth.planes[own], truth.plane_errors[own], _only(axes))


def _only(axes: list[FloatArray]) -> FloatArray:
    """The one continuous axis; of a sphere, which has several, every plane is good and nothing is to be learnt."""
    return axes[0] if len(axes) == 1 else np.zeros(6)
