"""How sure an answer may be: the confidence of a level, learned from damaged shapes whose truth is known.

Every shape is damaged in several ways and searched. Each group found is then held against the intact shape: it is right
if all of its elements map the intact surface onto itself within the threshold. A logistic regression of what the search
saw (`model.search.confidence.Evidence`) is fitted to a part of the shapes, and checked on the others: of all groups
that get a confidence of 0.8 eight in ten must be right.
"""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from model.errors import PRSNetError
from model.geometry.frames import UnitFrame
from model.geometry.refinement import squared_distances
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.meshes.mesh import Mesh
from model.paper.validation import MAX_ERROR
from model.search.confidence import NAMES, evidence, predict, terms
from model.types import BoolArray, FloatArray
from training.evaluation.corruptions import DAMAGES, corrupt
from training.evaluation.detectors import loaded
from training.layouts import SourceFile, find_meshes, parse
from training.parallel import spread
from training.shapes.catalogue import random_shape
from training.trainer.revision import git_revision

BINS = 10
_SAMPLES, _SEED = 1000, 15485863
_RIDGE, _STEPS = 1.0, 50
_FEWEST = 100
_CHECKED = 3
"""Every so many-th shape serves the check and is not fitted to."""


@dataclass(frozen=True, slots=True)
class Group:
    """One group that was found: on which ``shape``, how damaged, what was ``seen``, its ``error`` on the intact one."""

    shape: str
    damage: str
    name: str
    seen: tuple[float, ...]
    error: float


@dataclass(frozen=True, slots=True)
class _Job:
    """A shape: a file, or a procedural one."""

    source: SourceFile | None
    index: int
    seed: int

    @property
    def name(self) -> str:
        """What the shape is called."""
        return f"procedural/{self.index}" if self.source is None else self.source.name

    def mesh(self) -> Mesh:
        """The intact shape."""
        if self.source is not None:
            return parse(self.source.path.read_bytes(), self.source.path.name)
        shape = random_shape(np.random.default_rng([self.seed, self.index, _SEED]))
        return Mesh.checked(shape.vertices, shape.faces)


def collect(
    folders: Sequence[Path], *, limit: int, procedural: int = 0, seed: int = 0, workers: int = 1, progress: bool = True
) -> list[Group]:
    """Search shapes, each damaged in all ways of `DAMAGES`, and keep every group found.

    Args:
        folders: of meshes of the training split.
        limit: so many of them, drawn at random.
        procedural: so many shapes of `training.shapes` besides.
        seed: of all that is drawn.
        workers: processes.
        progress: show a bar.
    """
    sources = find_meshes(folders)
    drawn = np.random.default_rng(seed).permutation(len(sources))[:limit]
    jobs = [_Job(sources[index], int(index), seed) for index in drawn]
    jobs += [_Job(None, index, seed) for index in range(procedural)]
    results = tqdm(spread(_search, jobs, workers), total=len(jobs), unit="mesh", disable=not progress)
    return [group for groups in results for group in groups]


def _search(job: _Job) -> list[Group]:
    detector = loaded()
    try:
        mesh = job.mesh()
    except (PRSNetError, OSError):
        return []
    groups: list[Group] = []
    intact = UnitFrame.of(mesh.vertices, mesh.faces)
    for damage in DAMAGES[1:]:
        try:
            shown = corrupt(mesh.vertices, mesh.faces, damage, job.seed, job.index)
            frame = UnitFrame.of(shown.vertices, shown.faces)
            context, proposals, found = detector.search(frame.to_unit(shown.vertices), shown.faces)
        except PRSNetError:
            continue
        # The intact shape where the damaged one is, so that what was found needs no translation.
        whole = frame.to_unit(shown.similarity.to_shown(intact.to_unit(mesh.vertices)))
        surface = SurfaceIndex(whole, mesh.faces)
        samples, _ = sample_surface(whole, mesh.faces, _SAMPLES, seed=_SEED)
        ratio = frame.scale / shown.similarity.scale
        for level in found.levels:
            squared = squared_distances(surface, samples, level.measured_operations).mean(1)
            seen = astuple(evidence(context, level, proposals))
            groups.append(Group(job.name, damage, level.name, seen, float(squared.max() * ratio**2)))
    return groups


def calibrate(groups: Sequence[Group], max_error: float = MAX_ERROR) -> dict[str, Any]:
    """Fit the confidence to two thirds of the shapes, and check it on the others.

    Returns:
        ``evidence`` (names), ``coefficients``, and the check: ``groups`` and ``shapes`` (numbers of), ``error``, the
        expected calibration error; ``brier``, the mean squared difference; ``reliability``: mean confidence, share
        that is right and number of each bin.
    """
    shapes = sorted({group.shape for group in groups})
    held = {shape for index, shape in enumerate(shapes) if index % _CHECKED == 0}
    rows = np.array([group.seen for group in groups])
    right = np.array([group.error <= max_error for group in groups])
    check = np.array([group.shape in held for group in groups])
    coefficients = _fitted(terms(rows[~check]), right[~check])
    told = predict(coefficients, rows[check])
    return {
        "evidence": list(NAMES),
        "coefficients": [float(value) for value in coefficients],
        "groups": len(groups),
        "shapes": len(shapes),
        "checked": int(check.sum()),
        "error": expected_calibration_error(told, right[check]),
        "brier": float(np.square(told - right[check]).mean()),
        "reliability": reliability(told, right[check]),
    }


def reliability(told: FloatArray, right: BoolArray) -> list[dict[str, float]]:
    """Of each tenth of confidences that occurs: their mean, the share that is right, how many."""
    place = np.minimum((told * BINS).astype(int), BINS - 1)
    return [
        {
            "confidence": float(told[place == k].mean()),
            "right": float(right[place == k].mean()),
            "count": int((place == k).sum()),
        }
        for k in np.unique(place)
    ]


def expected_calibration_error(told: FloatArray, right: BoolArray) -> float:
    """Mean distance of confidences from what they promise, over ten bins weighted by their number."""
    bins = reliability(told, right)
    return sum(each["count"] * abs(each["confidence"] - each["right"]) for each in bins) / len(told)


def _fitted(rows: FloatArray, right: BoolArray) -> FloatArray:
    """Logistic regression with a small ridge, by Newton's method (iteratively reweighted least squares)."""
    coefficients = np.zeros(rows.shape[1])
    ridge = _RIDGE * np.eye(rows.shape[1])
    ridge[0, 0] = 0.0
    for _ in range(_STEPS):
        told = 1.0 / (1.0 + np.exp(-(rows @ coefficients)))
        weight = np.maximum(told * (1.0 - told), 1e-6)
        gradient = rows.T @ (right - told) - ridge @ coefficients
        step = np.linalg.solve(rows.T @ (weight[:, None] * rows) + ridge, gradient)
        coefficients = coefficients + step
        if np.abs(step).max() < 1e-9:
            break
    return coefficients


def run(
    folders: Sequence[Path],
    out: Path,
    *,
    limit: int,
    procedural: int,
    seed: int = 0,
    workers: int = 1,
    progress: bool = True,
) -> dict[str, Any]:
    """Collect, calibrate, and write the record with where it comes from; see `collect` for the arguments.

    Raises:
        ValueError: too few groups were found to learn from.
    """
    groups = collect(folders, limit=limit, procedural=procedural, seed=seed, workers=workers, progress=progress)
    if len(groups) < _FEWEST:
        raise ValueError(f"{len(groups)} groups were found on these shapes: {_FEWEST} are the least to learn from")
    names = sorted({group.shape for group in groups})
    record = calibrate(groups) | {
        "command": f"python -m training calibrate TRAIN --limit {limit} --procedural {procedural} --seed {seed}",
        "revision": git_revision(),
        "shapes_sha256": hashlib.sha256("\n".join(names).encode()).hexdigest(),
    }
    out.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    return record


def render(record: dict[str, Any]) -> str:
    """The check of a calibration as a table."""
    lines = [
        f"{record['groups']} groups on {record['shapes']} shapes; checked on {record['checked']} of other shapes: "
        f"expected calibration error {record['error']:.3f}, Brier score {record['brier']:.3f}",
        "",
        "| confidence | right | groups |",
        "| --- | --- | --- |",
    ]
    lines += [f"| {bin['confidence']:.2f} | {bin['right']:.2f} | {bin['count']} |" for bin in record["reliability"]]
    return "\n".join(lines)
