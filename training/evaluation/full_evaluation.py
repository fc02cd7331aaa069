"""`training evaluate --mode full`: how complete, exact and fast full mode is, beside other methods.

Every shape is damaged and posed (`corruptions`), shown to every method (`full_methods`), and the answers are matched
against what is known of the intact shape (`matching`). Errors are exact distances on samples no method has seen.
`full_report` turns the records into tables.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from model.errors import PRSNetError
from model.geometry.frames import UnitFrame
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.geometry.transforms import reflect, rotation_matrix
from model.meshes.mesh import Mesh
from model.paper.validation import MAX_ERROR
from model.types import FloatArray
from training.evaluation.corruptions import DAMAGES, show
from training.evaluation.full_methods import Answer, answer, check
from training.evaluation.matching import Found, FoundAxis, clear, match
from training.layouts import SourceFile, draw_meshes, parse
from training.oracle.known_truth import truth_of
from training.oracle.truth import Truth, load
from training.parallel import spread

DEFAULT_METHODS = ("full", "paper", "pca", "random", "exhaustive")
EXHAUSTIVE_LIMIT = 40
_JUDGE_SAMPLES, _FRESH_SAMPLES = 1500, 2000
_JUDGE_SEED, _FRESH_SEED = 7919, 104729
_SWEEP = 12
"""Angles a continuous axis is judged at; the worst counts."""


@dataclass(frozen=True, slots=True)
class Options:
    """What is asked of every shape. ``exhaustive`` is judged on ``exhaustive_limit`` random shapes only: it is slow."""

    damage: str = "clean"
    methods: tuple[str, ...] = DEFAULT_METHODS
    weights: str = "default"
    max_error: float = MAX_ERROR
    seed: int = 0
    exhaustive_limit: int = EXHAUSTIVE_LIMIT


@dataclass(frozen=True, slots=True)
class _Job:
    source: SourceFile
    index: int
    methods: tuple[str, ...]
    truth: Truth | None
    options: Options


def evaluate(
    folders: Sequence[Path],
    options: Options,
    *,
    limit: int | None = None,
    ground_truth: Path | None = None,
    workers: int = 1,
    resume: Path | None = None,
    progress: bool = True,
) -> list[dict[str, Any]]:
    """Judge the methods on the meshes below ``folders``.

    Args:
        folders: searched by `training.layouts.find_meshes`. A ``ground_truth.json`` that `training shapes` wrote beside
            the meshes is used.
        options: what to do.
        limit: judge so many shapes, drawn at random.
        ground_truth: file of `training groundtruth`; shapes it does not know are searched on the spot, seconds each.
        workers: processes.
        resume: a file that takes every record as soon as it is made; what it holds from an interrupted call with the
            same options is not judged again.
        progress: show a bar.

    Returns:
        one record of plain values a shape, sorted by name (`judge`); those that could not be read say ``skipped``.

    Raises:
        ValueError: nothing to judge, or an option is out of range.
    """
    check(options.methods)
    if options.damage not in DAMAGES:
        raise ValueError(f"damage is one of {', '.join(DAMAGES)}, not {options.damage!r}")
    known: Mapping[str, Truth] = load(ground_truth) if ground_truth is not None else {}
    rng = np.random.default_rng(options.seed)
    sources = draw_meshes(folders, limit, rng)
    slow = set(rng.permutation(len(sources))[: options.exhaustive_limit].tolist())
    records = _resumed(resume, options)
    jobs = [
        _Job(
            source,
            index,
            tuple(method for method in options.methods if method != "exhaustive" or row in slow),
            known.get(source.name),
            options,
        )
        for row, (index, source) in enumerate(sources)
        if source.name not in records
    ]
    for record in tqdm(spread(_judge_file, jobs, workers, chunk=2), total=len(jobs), unit="mesh", disable=not progress):
        records[record["name"]] = record
        if resume is not None:
            with resume.open("a", encoding="utf-8") as lines:
                lines.write(json.dumps(record) + "\n")
    names = {source.name for _, source in sources}
    return [records[name] for name in sorted(records) if name in names]


def _resumed(file: Path | None, options: Options) -> dict[str, dict[str, Any]]:
    """The records of an earlier call, none if it was another one; the first line says which."""
    head = json.dumps({"options": asdict(options)})
    if file is None:
        return {}
    lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
    if not lines or lines[0] != head:
        file.write_text(head + "\n", encoding="utf-8")
        return {}
    records: dict[str, dict[str, Any]] = {}
    whole: list[str] = [head]
    for line in lines[1:]:
        try:
            record = json.loads(line)
        except json.JSONDecodeError:  # cut off while it was written
            continue
        records[record["name"]] = record
        whole.append(line)
    file.write_text("\n".join(whole) + "\n", encoding="utf-8")
    return records


def _judge_file(job: _Job) -> dict[str, Any]:
    head = {"name": job.source.name, "source": job.source.category or job.source.source}
    try:
        mesh = parse(job.source.path.read_bytes(), job.source.path.name)
        frame = UnitFrame.of(mesh.vertices, mesh.faces)
    except (PRSNetError, OSError) as error:
        return head | {"skipped": str(error)}
    truth, group = truth_of(job.source.path, mesh, frame, job.truth)
    return head | {"group": group} | judge(mesh, truth, job.index, job.methods, job.options)


def judge(mesh: Mesh, truth: Truth, index: int, methods: Sequence[str], options: Options) -> dict[str, Any]:
    """Show one shape to every method.

    Returns:
        ``faces`` (of the file), ``shown_faces``, ``clear_planes``, ``clear_axes``, ``shown_sde`` (errors of the clear
        planes on the mesh as it is shown), ``listed`` (true planes and axes of any error) and ``methods``: a record
        each, see `_record`.
    """
    shown = show(mesh.vertices, mesh.faces, options.damage, options.seed, index)
    intact = UnitFrame.of(mesh.vertices, mesh.faces).to_unit(mesh.vertices)
    whole = _Judge(intact, mesh.faces, _JUDGE_SAMPLES, _JUDGE_SEED)
    frame = UnitFrame.of(shown.vertices, shown.faces)
    seen = _Judge(frame.to_unit(shown.vertices), shown.faces, _FRESH_SAMPLES, _FRESH_SEED)
    certain = clear(truth)
    records: dict[str, Any] = {}
    for method in methods:
        given = answer(
            method,
            options.weights,
            Mesh.checked(shown.vertices, shown.faces),
            options.max_error,
            (options.seed, index),
        )
        found = given.found
        in_unit = Found(
            shown.similarity.planes_to_unit(found.planes),
            [
                FoundAxis(
                    shown.similarity.directions_to_unit(axis.direction),
                    shown.similarity.points_to_unit(axis.point),
                    axis.order,
                )
                for axis in found.axes
            ],
        )
        fresh = [seen.plane(frame.plane_to_unit(plane)) for plane in found.planes]
        fresh += [seen.axis(axis.direction, frame.to_unit(axis.point), axis.order) for axis in found.axes]
        records[method] = _record(given, in_unit, truth, certain, whole, fresh)
    return {
        "faces": len(mesh.faces),
        "shown_faces": len(shown.faces),
        "clear_planes": len(certain.planes),
        "clear_axes": len(certain.axes),
        "truth_planes": len(truth.planes),
        "shown_sde": [
            seen.plane(frame.plane_to_unit(plane)) for plane in shown.similarity.planes_to_shown(certain.planes)
        ],
        "listed": len(truth.planes) + len(truth.axes),
        "methods": records,
    }


def _record(
    given: Answer, found: Found, truth: Truth, certain: Truth, whole: "_Judge", fresh: list[float]
) -> dict[str, Any]:
    """What is kept of an answer; ``found`` in the unit frame of the intact shape."""
    to_clear, to_all = match(certain, found), match(truth, found)
    return {
        "planes": found.planes.tolist(),
        "axes": [
            {"direction": axis.direction.tolist(), "point": axis.point.tolist(), "order": axis.order}
            for axis in found.axes
        ],
        "plane_sde": [whole.plane(plane) for plane in found.planes],
        "fresh_sde": fresh,
        "planes_found": to_clear.planes.tolist(),
        "angles": to_clear.angles[to_clear.planes].tolist(),
        "axes_found": to_clear.axes.tolist(),
        "orders_found": to_clear.orders.tolist(),
        "dominant": bool(to_clear.true_planes[:1].any()),
        "unlisted": int((~to_all.true_planes).sum() + (~to_all.true_axes).sum()),
        "ms": given.milliseconds,
        "stages": given.stages,
        "point_group": given.point_group,
        "exact": given.exact,
    }


class _Judge:
    """Symmetry errors on samples of one surface, in its unit frame."""

    def __init__(self, vertices: FloatArray, faces: Any, count: int, seed: int) -> None:
        self._surface = SurfaceIndex(vertices, faces)
        self._samples, _ = sample_surface(vertices, faces, count, seed=seed)

    def plane(self, plane: FloatArray) -> float:
        return self._surface.mean_squared_distance(reflect(self._samples, plane))

    def axis(self, direction: FloatArray, point: FloatArray, order: int | None) -> float:
        """SDE of the rotation by 2π/``order``; of a continuous axis the largest over some angles."""
        if order is not None:
            angles = [2.0 * np.pi / order]
        else:
            angles = [2.0 * np.pi * (step - 0.38) / (2 * _SWEEP + 1) for step in range(1, _SWEEP + 1)]
        arms = self._samples - point
        turned = (arms @ rotation_matrix(direction, angle).T + point for angle in angles)
        return max(self._surface.mean_squared_distance(points) for points in turned)
