"""How sure an answer may be: the confidence of a level, learned from damaged shapes whose truth is known.

Every shape is damaged in several ways and searched. Each group found is then held against the intact shape: it is right
if all of its elements map the intact surface onto itself within the threshold. A logistic regression of what the search
saw (`model.search.confidence.Evidence`) is fitted to a part of the shapes, and checked on the others: of all groups
that get a confidence of 0.8 eight in ten must be right.

The same for what the network alone sees (`model.search.prediction`), on those damaged shapes of which no measured group
is believed by then: only there it is asked.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from model.detector import Detector, use_one_thread
from model.errors import PRSNetError
from model.geometry.frames import UnitFrame
from model.meshes.mesh import Mesh
from model.paper.validation import MAX_ERROR
from model.search import prediction
from model.search.confidence import NAMES, evidence, predict, terms
from model.search.settings import DEFAULT
from model.symmetries import EvidenceKind
from model.types import BoolArray, FloatArray, IntArray
from training.evaluation.corruptions import DAMAGES, corrupt
from training.evaluation.intact import IntactShape
from training.layouts import SourceFile, find_meshes, parse
from training.oracle.exhaustive import CONTRAST
from training.oracle.truth import CLEAR_ERROR
from training.parallel import spread
from training.shapes.catalogue import random_shape
from training.trainer.revision import git_revision

BINS = 10
_SEED = 15485863
_RIDGE, _STEPS = 1.0, 50
_FEWEST = 100
_CHECKED = 3
"""Every so many-th shape serves the check and is not fitted to."""


@dataclass(frozen=True, slots=True)
class Group:
    """One group that was found: on which ``shape``, how damaged, what was ``seen``, its ``error`` on the intact one.

    ``evidence``: of a measured group, or of a guess of the network.
    """

    shape: str
    damage: str
    name: str
    seen: tuple[float, ...]
    error: float
    contrast: float
    evidence: EvidenceKind = "measured"

    def is_right(self, max_error: float) -> bool:
        """Whether the group is one of the intact shape: it holds there, and what is tilted a little does not as well.

        What the exhaustive search of `training.oracle` calls a symmetry: on a lump, a tree, any plane holds roughly.
        """
        return self.error <= max_error and (self.contrast >= CONTRAST or self.error < CLEAR_ERROR)

    @property
    def mesh(self) -> tuple[str, str]:
        """Which mesh it was found on."""
        return self.shape, self.damage


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


@lru_cache(maxsize=1)
def _detector() -> Detector:
    """Not warmed up: a whole detection reads the confidence that is yet to be learned."""
    use_one_thread()
    return Detector.load()


def _search(job: _Job) -> list[Group]:
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
            context, network, found = _detector().search(frame.to_unit(shown.vertices), shown.faces)
            thought = [] if network is None or context.meter.closed else prediction.guesses(context, network)
        except PRSNetError:
            continue
        # The intact shape where the damaged one is, so that what was found needs no translation.
        whole = frame.to_unit(shown.similarity.to_shown(intact.to_unit(mesh.vertices)))
        truth = IntactShape(whole, mesh.faces, frame.scale / shown.similarity.scale)
        for level in found.levels:
            level = level.measured(context, thoroughly=True)  # as an answer is
            seen = astuple(evidence(context, level, network))
            groups.append(Group(job.name, damage, level.name, seen, *truth.judged(level)))
        for guess in thought:
            judged = truth.judged(guess.level)
            groups.append(Group(job.name, damage, guess.level.name, guess.row, *judged, "predicted"))
    return groups


def calibrate(groups: Sequence[Group], max_error: float = MAX_ERROR) -> dict[str, Any]:
    """Fit the confidence to two thirds of the shapes, and check it on the others.

    Guesses are few: all are fitted to, and each third is checked by what is fitted to the two others; of each mesh the
    likeliest, as it is the one that may be the answer.

    Returns:
        ``measured`` and, where there are guesses, ``predicted``, of each its ``evidence`` (names) with their
        ``means``, ``coefficients``, and the check: ``groups`` and ``shapes`` (numbers of), ``error``, the expected
        calibration error; ``brier``, the mean squared difference; ``reliability``: mean confidence, share that is right
        and number of each bin.
    """
    third = {shape: index % _CHECKED for index, shape in enumerate(sorted({group.shape for group in groups}))}
    measured = [group for group in groups if group.evidence == "measured"]
    rows, right, thirds = _table(measured, third, max_error)
    check = thirds == 0
    coefficients = _fitted(terms(rows[~check]), right[~check])
    told = predict(coefficients, rows)
    record = {"measured": _record(NAMES, coefficients, measured, rows, told[check], right[check])}
    believed = {group.mesh for group, sure in zip(measured, told, strict=True) if sure >= DEFAULT.least_confidence}
    guesses = [group for group in groups if group.evidence == "predicted" and group.mesh not in believed]
    if guesses:
        rows, right, thirds = _table(guesses, third, max_error)
        rows = prediction.weighed(rows, coefficients)
        told = np.empty(len(rows))
        for held in range(_CHECKED):
            others = _fitted(prediction.terms(rows[thirds != held]), right[thirds != held])
            told[thirds == held] = prediction.predict(others, rows[thirds == held])
        best: dict[tuple[str, str], int] = {}
        for index in np.argsort(told, kind="stable").tolist():
            best[guesses[index].mesh] = index
        likeliest = np.array(list(best.values()))
        coefficients = _fitted(prediction.terms(rows), right)
        record["predicted"] = _record(prediction.NAMES, coefficients, guesses, rows, told[likeliest], right[likeliest])
    return record


def _table(
    groups: Sequence[Group], third: Mapping[str, int], max_error: float
) -> tuple[FloatArray, BoolArray, IntArray]:
    """What was seen ``(n, e)``, which groups are right and which third of the shapes they are of: ``(n,)``."""
    rows = np.array([group.seen for group in groups])
    right = np.array([group.is_right(max_error) for group in groups], dtype=np.bool_)
    return rows, right, np.array([third[group.shape] for group in groups])


def _record(
    names: Sequence[str],
    coefficients: FloatArray,
    groups: Sequence[Group],
    rows: FloatArray,
    told: FloatArray,
    right: BoolArray,
) -> dict[str, Any]:
    return {
        "evidence": list(names),
        "coefficients": coefficients.tolist(),
        "means": rows.mean(0).tolist(),
        "groups": len(groups),
        "shapes": len({group.shape for group in groups}),
        "checked": len(told),
        "error": expected_calibration_error(told, right),
        "brier": float(np.square(told - right).mean()),
        "reliability": reliability(told, right),
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
        ValueError: too few groups were found, or too few guesses where none is believed, to learn from.
    """
    groups = collect(folders, limit=limit, procedural=procedural, seed=seed, workers=workers, progress=progress)
    if len(groups) < _FEWEST:
        raise ValueError(f"{len(groups)} groups were found on these shapes: {_FEWEST} are the least to learn from")
    names = sorted({group.shape for group in groups})
    record: dict[str, Any] = {
        "command": f"python -m training calibrate TRAIN --limit {limit} --procedural {procedural} --seed {seed}",
        "revision": git_revision(),
        "shapes_sha256": hashlib.sha256("\n".join(names).encode()).hexdigest(),
    } | calibrate(groups)
    guesses = record.get("predicted", {"groups": 0})["groups"]
    if guesses < _FEWEST:
        raise ValueError(f"the network made {guesses} guesses on these shapes: {_FEWEST} are the least to learn from")
    out.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    return record


def render(record: dict[str, Any]) -> str:
    """The checks of a calibration as tables."""
    lines: list[str] = []
    for kind in ("measured", "predicted"):
        if kind not in record:
            continue
        part = record[kind]
        lines += [
            f"{kind}: {part['groups']} groups on {part['shapes']} shapes; checked on {part['checked']} of other "
            f"shapes: expected calibration error {part['error']:.3f}, Brier score {part['brier']:.3f}",
            "",
            "| confidence | right | groups |",
            "| --- | --- | --- |",
        ]
        lines += [f"| {bin['confidence']:.2f} | {bin['right']:.2f} | {bin['count']} |" for bin in part["reliability"]]
        lines.append("")
    return "\n".join(lines).rstrip()
