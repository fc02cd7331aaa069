"""`training evaluate`: what networks say in one go, beside classical methods that answer as fast.

Every shape is posed and damaged (`corruptions`). Raw output is judged as it leaves the network, validated output
as a client of paper mode receives it; both on exact distances, against the intact shape, with samples that detection
never saw. `training.evaluation.network_report` turns the records into tables.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from model.detector import Detector, use_one_thread
from model.errors import PRSNetError
from model.geometry.frames import UnitFrame
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.geometry.transforms import reflect
from model.meshes.mesh import Mesh
from model.network.checkpoint import InputSpec, load_checkpoint
from model.types import FloatArray
from training.baselines.classical import box_planes, pca_planes, untrained
from training.evaluation.corruptions import DAMAGES, CorruptedShape, show
from training.evaluation.matching import clear_axes_found, clear_planes_found, ground_truth_error, nearest_clear_plane
from training.layouts import SourceFile, draw_meshes, parse
from training.oracle.known_truth import truth_of
from training.oracle.truth import Truth, load
from training.parallel import spread

JUDGE_SAMPLES = 1500
_JUDGE_SEED = 7919
UNTRAINED = "untrained"
PCA = "PCA"
BOX = "oriented bounding box"
BASELINES = {PCA: pca_planes, BOX: box_planes}
TOLERANCES = ((1.0, 0.01), (5.0, 0.05))
"""Degrees, and distance in the unit frame, within which a true plane or axis counts as met."""


@dataclass(frozen=True, slots=True)
class Options:
    """What every worker needs to know: ``damage`` is one of `training.evaluation.corruptions.DAMAGES`."""

    weights: tuple[str, ...]
    damage: str = "rotated"
    seed: int = 0


@dataclass(frozen=True, slots=True)
class _Job:
    source: SourceFile
    index: int
    truth: Truth | None
    options: Options


def evaluate(
    folders: Sequence[Path],
    options: Options,
    *,
    limit: int | None = None,
    ground_truth: Path | None = None,
    workers: int = 1,
    progress: bool = True,
) -> list[dict[str, Any]]:
    """Judge weights and their rivals on the meshes below ``folders``.

    Args:
        folders: searched by `training.layouts.find_meshes`. A ``ground_truth.json`` that `training shapes` wrote beside
            the meshes is used.
        options: what to do.
        limit: judge so many shapes, drawn at random.
        ground_truth: file of `training groundtruth`; shapes it does not know are searched on the spot, seconds each.
        workers: processes.
        progress: show a bar.

    Returns:
        one record of plain values a shape (`judge`); those that could not be read say ``skipped``.

    Raises:
        ValueError: nothing to judge, or an unknown damage.
    """
    if options.damage not in DAMAGES:
        raise ValueError(f"damage is one of {', '.join(DAMAGES)}, not {options.damage!r}")
    known: Mapping[str, Truth] = load(ground_truth) if ground_truth is not None else {}
    sources = draw_meshes(folders, limit, np.random.default_rng(options.seed))
    jobs = [_Job(source, index, known.get(source.name), options) for index, source in sources]
    found = spread(_judge_file, jobs, workers, chunk=4)
    return list(tqdm(found, total=len(jobs), unit="mesh", disable=not progress))


@lru_cache
def _detectors(weights: tuple[str, ...]) -> dict[str, Detector]:
    use_one_thread()
    detectors = {name: Detector(load_checkpoint(name)) for name in weights}
    detectors[UNTRAINED] = Detector(untrained(InputSpec("unit")))
    for detector in detectors.values():
        detector.warm_up()
    return detectors


def _judge_file(job: _Job) -> dict[str, Any]:
    head = {"name": job.source.name, "source": job.source.category or job.source.source}
    try:
        mesh = parse(job.source.path.read_bytes(), job.source.path.name)
        frame = UnitFrame.of(mesh.vertices, mesh.faces)
        shown = show(mesh.vertices, mesh.faces, job.options.damage, job.options.seed, job.index)
        UnitFrame.of(shown.vertices, shown.faces)
    except (PRSNetError, OSError) as error:
        return head | {"skipped": str(error)}
    truth, _ = truth_of(job.source.path, mesh, frame, job.truth)
    return head | judge(mesh, shown, truth, _detectors(job.options.weights))


def judge(mesh: Mesh, shown: CorruptedShape, truth: Truth, detectors: Mapping[str, Detector]) -> dict[str, Any]:
    """One shape, every method.

    Returns:
        ``faces``, ``clear_planes`` and ``clear_axes`` (numbers of), and ``methods``, a dictionary each: ``raw`` (SDE of
        every plane on the intact shape); where the shape has a clear plane ``gte`` and ``angle`` (degrees) of the best
        of them, ``gte_closest`` of the one with the smallest GTE, ``found`` (clear planes met, for each of
        `TOLERANCES`); for networks also ``axes`` (clear axes met), ``validated`` (SDE of the planes of paper mode),
        ``validated_axes`` (how many) and ``ms`` (CPU time of what the network does: all its frames and passes).
    """
    intact = UnitFrame.of(mesh.vertices, mesh.faces).to_unit(mesh.vertices)
    surface = SurfaceIndex(intact, mesh.faces)
    samples, _ = sample_surface(intact, mesh.faces, JUDGE_SAMPLES, seed=_JUDGE_SEED)
    frame = UnitFrame.of(shown.vertices, shown.faces)
    vertices = frame.to_unit(shown.vertices)

    def errors(planes: FloatArray) -> list[float]:
        return [surface.mean_squared_distance(reflect(samples, plane)) for plane in planes]

    def judged(raw: FloatArray) -> dict[str, Any]:
        planes = shown.similarity.planes_to_unit(np.array([frame.plane_to_input(plane) for plane in raw]))
        said: dict[str, Any] = {"raw": errors(planes)}
        best = planes[int(np.argmin(said["raw"]))]
        nearest = nearest_clear_plane(truth, best)
        if nearest is not None:
            each = [ground_truth_error(truth, plane) for plane in planes]
            said["gte"] = each[int(np.argmin(said["raw"]))]
            said["gte_closest"] = min(error for error in each if error is not None)
            said["angle"] = float(np.degrees(np.arccos(np.clip(best[:3] @ nearest[:3], -1.0, 1.0))))
            said["found"] = [clear_planes_found(truth, planes, *tolerance) for tolerance in TOLERANCES]
        return said

    methods = {name: judged(planes_of(vertices, shown.faces)) for name, planes_of in BASELINES.items()}
    for name, detector in detectors.items():
        timings: dict[str, float] = {}
        mark = time.thread_time()
        proposals = detector.propose(vertices, shown.faces, timings)
        spent = (time.thread_time() - mark) * 1e3 - timings["voxelize"]
        directions = shown.similarity.directions_to_unit(proposals.directions)
        detection = detector.detect((shown.vertices, shown.faces), mode="paper")
        accepted = np.array([np.append(plane.normal, plane.offset) for plane in detection.planes]).reshape(-1, 4)
        methods[name] = judged(proposals.planes) | {
            "axes": [clear_axes_found(truth, directions, *tolerance) for tolerance in TOLERANCES],
            "validated": errors(shown.similarity.planes_to_unit(accepted)),
            "validated_axes": len(detection.axes),
            "ms": max(spent, 0.0),
        }
    return {
        "faces": len(mesh.faces),
        "clear_planes": len(truth.clear_planes()),
        "clear_axes": len(truth.clear_axes()),
        "methods": methods,
    }
