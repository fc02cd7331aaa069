"""`training evaluate --protocol shrec`: planes of point clouds, ranked by confidence, as the SHREC 2023 track counts.

The planes a method returns are gone through, the most confident first. One is right if it is within `ANGLE` of a true
plane that none before it has met and its point within `DISTANCE` of it. Its point is that nearest to the mean of the
cloud. What the columns say:

- *mAP*: the mean over the clouds of their average precision: over the right planes, the mean share of right ones up to
  there; 0 where none is right. It does not see what is missing: one right plane and nothing else has 100 %.
- *PHC*: share of the clouds whose most confident plane is right.
- *recall*: share of all true planes that were met; *all planes*: share of the clouds of which every one was.
- *wrong*: returned planes a cloud that are none, or one once more.
- *angle*: degrees between right planes and theirs.

A method that tells no confidence is taken in its own order. Each gets the surface that `model.meshes.points` joins
through the points, as the service does; the time of that is not counted. A cloud of which none can be made counts as
one without an answer.
"""

import io
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from model.errors import PRSNetError
from model.paper.validation import MAX_ERROR
from model.types import FloatArray
from training.evaluation.matching import Found, angle_between
from training.evaluation.method import Answer
from training.evaluation.registry import build_all, expand, method_record
from training.evaluation.report import Column, average_precision, table
from training.evaluation.resuming import Kept
from training.layouts import parse
from training.parallel import spread
from training.shapes.clouds import PERTURBATIONS, KnownCloud, draw_cloud

ANGLE = 1.0
"""Degrees."""

DISTANCE = 0.01
"""Of the diagonal of the cloud's bounding box."""

CLOUDS = 99
"""Of each perturbation where no number is given: eleven of each family."""

COLUMNS: tuple[Column, ...] = (
    ("shapes", "clouds", "{:d}"),
    ("map", "mAP", "{:.1%}"),
    ("phc", "PHC", "{:.1%}"),
    ("recall", "recall", "{:.1%}"),
    ("all_planes", "all planes", "{:.1%}"),
    ("returned", "planes a cloud", "{:.2f}"),
    ("wrong", "wrong", "{:.2f}"),
    ("angle", "angle, median °", "{:.2g}"),
    ("ms", "ms p50", "{:.1f}"),
)


@dataclass(frozen=True, slots=True)
class Options:
    """What is asked of every cloud.

    Attributes:
        perturbation: one of `training.shapes.clouds.PERTURBATIONS`.
        methods: names of `training.evaluation.registry`.
        max_error: threshold on the SDE of methods that have one.
        seed: of the clouds.
    """

    perturbation: str
    methods: tuple[str, ...]
    max_error: float = MAX_ERROR
    seed: int = 0


@dataclass(frozen=True, slots=True)
class _Job:
    index: int
    methods: tuple[str, ...]
    options: Options


def evaluate_clouds(
    options: Options,
    *,
    limit: int = CLOUDS,
    workers: int = 1,
    resume: Path | None = None,
    renew: Sequence[str] = (),
    progress: bool = True,
) -> list[dict[str, Any]]:
    """Judge the methods on the first ``limit`` clouds.

    Args:
        options: what to do.
        limit: clouds.
        workers: processes.
        resume: a file that takes every record as soon as it is made; what it holds of an earlier call with the same
            options, whatever its methods were, is not judged again.
        renew: of these methods it is, where the answers are of another revision of the code.
        progress: show a bar.

    Returns:
        a record of plain values a cloud: ``name``, ``family``, ``true_planes``, ``points``, and ``methods`` with
        ``matches`` (of each plane, in the order in which they count) and ``angles`` (of the right ones).

    Raises:
        ValueError: an option is out of range.
    """
    asked = {name: method_record(name) for name in expand(options.methods)}
    if options.perturbation not in PERTURBATIONS:
        raise ValueError(f"perturbation is one of {', '.join(PERTURBATIONS)}, not {options.perturbation!r}")
    kept = Kept(resume, asdict(options), asked, renew)
    names = {_name(index): index for index in range(limit)}
    jobs = [_Job(index, missing, options) for name, index in names.items() if (missing := kept.missing(name))]
    jobs.sort(key=lambda job: job.methods)
    for record in tqdm(spread(_judge, jobs, workers, chunk=2), total=len(jobs), unit="cloud", disable=not progress):
        kept.add(record)
    return kept.listed(names)


def _name(index: int) -> str:
    return f"{index:05d}"


def _judge(job: _Job) -> dict[str, Any]:
    options = job.options
    cloud = draw_cloud(job.index, options.perturbation, options.seed)
    data = io.BytesIO()
    np.save(data, cloud.points)
    try:
        mesh = parse(data.getvalue(), "cloud.npy")
    except PRSNetError:
        mesh = None
    records: dict[str, Any] = {}
    for name, method in build_all(job.methods, options.max_error).items():
        started = time.process_time()
        answer = Answer(Found(np.zeros((0, 4)))) if mesh is None else method(mesh, (options.seed, job.index))
        spent = 1e3 * (time.process_time() - started) + answer.reused_ms
        planes = ranked(answer)
        matches, angles = met(cloud, planes)
        records[name] = {
            "title": method.title, "planes": planes.tolist(), "matches": matches, "angles": angles, "ms": spent
        }  # fmt: skip
    return {
        "name": _name(job.index),
        "family": cloud.family + (", cone" if cloud.is_cone else ""),
        "true_planes": len(cloud.planes),
        "points": len(cloud.points),
        "methods": records,
    }


def ranked(answer: Answer) -> FloatArray:
    """The planes ``(k, 4)`` of an answer, the most confident first."""
    planes = answer.found.planes
    if answer.confidence is None:
        return planes
    return planes[np.argsort(-np.array(answer.confidence), kind="stable")]


def met(cloud: KnownCloud, planes: FloatArray) -> tuple[list[bool], list[float]]:
    """Which of the planes ``(k, 4)`` meet a true one that none before has met, and at which angles (degrees).

    A plane that is near to several meets the nearest, by angle and distance together.
    """
    centre = cloud.points.mean(0)
    diagonal = float(np.linalg.norm(cloud.points.max(0) - cloud.points.min(0)))
    left = list(cloud.planes)
    matches: list[bool] = []
    angles: list[float] = []
    for plane in planes:
        point = centre - (plane[:3] @ centre + plane[3]) * plane[:3]
        near = [(angle_between(plane[:3], true[:3]), abs(true[:3] @ point + true[3]) / diagonal) for true in left]
        within = [row for row, (angle, distance) in enumerate(near) if angle <= ANGLE and distance <= DISTANCE]
        matches.append(bool(within))
        if within:
            row = min(within, key=lambda row: (1.0 - np.cos(np.radians(near[row][0]))) + near[row][1])
            angles.append(near[row][0])
            left.pop(row)
    return matches, angles


def summarise_clouds(records: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
    """Figures of `COLUMNS` by method, over the records of `evaluate_clouds`; shares are fractions.

    Raises:
        ValueError: there are no records.
    """
    if not records:
        raise ValueError("no cloud was judged")
    true = np.array([record["true_planes"] for record in records])
    figures: dict[str, dict[str, Any]] = {}
    for method in records[0]["methods"]:
        answers = [record["methods"][method] for record in records]
        matches: list[list[bool]] = [answer["matches"] for answer in answers]
        right = np.array([sum(row) for row in matches])
        angles = [angle for answer in answers for angle in answer["angles"]]
        figures[method] = {
            "title": answers[0]["title"],
            "shapes": len(records),
            "map": float(np.mean([average_precision(row) for row in matches])),
            "phc": float(np.mean([bool(row and row[0]) for row in matches])),
            "recall": float(right.sum() / true.sum()),
            "all_planes": float((right == true).mean()),
            "returned": float(np.mean([len(row) for row in matches])),
            "wrong": float(np.mean([len(row) - sum(row) for row in matches])),
            **({"angle": float(np.median(angles))} if angles else {}),
            "ms": float(np.median([answer["ms"] for answer in answers])),
        }
    return figures


def heading(records: Sequence[Mapping[str, Any]], perturbation: str) -> str:
    """A line on the clouds."""
    planes, points = sum(record["true_planes"] for record in records), int(np.median([r["points"] for r in records]))
    return (
        f"{perturbation}: {len(records)} clouds of {points} points, {planes} planes; within {ANGLE:g}°, {DISTANCE:.0%}"
    )


def run(
    perturbations: Sequence[str],
    methods: Sequence[str],
    *,
    max_error: float = MAX_ERROR,
    seed: int = 0,
    limit: int = CLOUDS,
    workers: int = 1,
    json_file: Path | None = None,
    progress: bool = True,
) -> str:
    """Judge, write the records, and return the tables, one a perturbation.

    Args:
        perturbations: of `PERTURBATIONS`.
        methods: names of `training.evaluation.registry`.
        max_error: threshold on the SDE of methods that have one.
        seed: of the clouds.
        limit: clouds of each perturbation.
        workers: processes.
        json_file: takes options, figures and records. While the run lasts, FILE.PERTURBATION.part takes the records; a
            run that was interrupted goes on from there.
        progress: show a bar.

    Raises:
        ValueError: an argument does not fit.
    """
    sections: list[str] = []
    documents: list[dict[str, Any]] = []
    parts: list[Path] = []
    for perturbation in perturbations:
        options = Options(perturbation, tuple(methods), max_error, seed)
        part = None if json_file is None else json_file.with_name(f"{json_file.name}.{perturbation}.part")
        records = evaluate_clouds(options, limit=limit, workers=workers, resume=part, progress=progress)
        figures = summarise_clouds(records)
        sections.append(f"{heading(records, perturbation)}\n\n{table(figures, COLUMNS)}")
        documents.append({"options": asdict(options), "figures": figures, "clouds": records})
        parts += [] if part is None else [part]
    if json_file is not None:
        json_file.write_text(json.dumps(documents) + "\n", encoding="utf-8")
        for part in parts:
            part.unlink()
    return "\n\n".join(sections)
