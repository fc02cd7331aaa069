"""`training evaluate`: weights beside PCA and the untrained network, on meshes nobody trained on.

Every shape is put into a random pose. Raw output is judged as it leaves the network, validated output as a client of
paper mode receives it; both on exact distances, against the intact shape, with samples that detection never saw.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from model.checkpoint import InputSpec, load_checkpoint
from model.detector import Detector, use_one_thread
from model.errors import PRSNetError
from model.formats import read_mesh
from model.frames import UnitFrame
from model.sampling import sample_surface
from model.surface import SurfaceIndex
from model.transforms import reflect
from model.types import FloatArray
from model.validation import MAX_ERROR
from training.baselines import pca_planes, untrained
from training.damage import cut_ball
from training.groundtruth import find_symmetries
from training.known_truth import written_truth
from training.parallel import spread
from training.prepare import SourceFile, find_meshes
from training.solids import random_rotation

JUDGE_SAMPLES = 1500
_JUDGE_SEED = 7919
UNTRAINED = "untrained"
PCA = "PCA"


@dataclass(frozen=True, slots=True)
class Options:
    """What every worker needs to know."""

    weights: tuple[str, ...]
    damage: str
    seed: int


@dataclass(slots=True)
class ShapeResult:
    """One shape: ``reference`` planes in its unit frame, and per method the errors of its planes."""

    name: str
    source: str
    clear: int = 0
    reference: list[list[float]] = field(default_factory=list[list[float]])
    methods: dict[str, dict[str, Any]] = field(default_factory=dict[str, dict[str, Any]])
    skipped: str | None = None


def evaluate(
    folders: Sequence[Path],
    weights: Sequence[str],
    *,
    limit: int | None = None,
    damage: str = "clean",
    seed: int = 0,
    workers: int = 1,
    reference: Path | None = None,
    progress: bool = True,
) -> dict[str, Any]:
    """Judge ``weights`` on the meshes below ``folders``; see `training evaluate --help` for the arguments.

    Returns:
        a report of plain values: ``shapes``, ``clear`` (those that have a clear plane), ``skipped``, ``damage``, and
        ``methods``: one dictionary of figures each (`summarise`).

    Raises:
        ValueError: nothing to judge, or an unknown damage.
    """
    if damage not in ("clean", "partial"):
        raise ValueError(f"damage is clean or partial, not {damage!r}")
    sources = find_meshes(folders)
    if limit is not None and limit < len(sources):
        chosen = np.random.default_rng(seed).permutation(len(sources))[:limit]
        sources = [sources[index] for index in sorted(chosen)]
    known: dict[str, Any] = {}
    if reference is not None and reference.is_file():
        known = json.loads(reference.read_text())
    jobs = [
        (source, Options(tuple(weights), damage, seed), index, known.get(source.name))
        for index, source in enumerate(sources)
    ]
    results = list(
        tqdm(spread(_judge_shape, jobs, workers, chunk=4), total=len(jobs), unit="mesh", disable=not progress)
    )
    if reference is not None:
        known |= {result.name: result.reference for result in results if result.skipped is None}
        reference.write_text(json.dumps(known))
    return summarise(results, weights, damage)


@lru_cache
def _detectors(weights: tuple[str, ...]) -> dict[str, Detector]:
    use_one_thread()
    detectors = {name: Detector(load_checkpoint(name)) for name in weights}
    detectors[UNTRAINED] = Detector(untrained(InputSpec("unit")))
    return detectors


def _judge_shape(job: tuple[SourceFile, Options, int, list[list[float]] | None]) -> ShapeResult:
    source, options, index, known = job
    result = ShapeResult(source.name, source.source)
    try:
        mesh = read_mesh(source.path.read_bytes(), source.path.name)
        frame = UnitFrame.of(mesh.vertices, mesh.faces)
    except (PRSNetError, OSError) as error:
        result.skipped = str(error)
        return result
    vertices, faces = frame.to_unit(mesh.vertices), mesh.faces
    if known is None:
        known = _written_planes(source.path, frame) or find_symmetries(vertices, faces).clear_planes().tolist()
    result.reference, result.clear = known, len(known)
    rng = np.random.default_rng([options.seed, index])
    pose = random_rotation(rng)
    posed = np.ascontiguousarray(vertices @ pose.T)
    truth = np.array(known).reshape(-1, 4).copy()
    truth[:, :3] = truth[:, :3] @ pose.T
    surface = SurfaceIndex(posed, faces)
    judge, _ = sample_surface(posed, faces, JUDGE_SAMPLES, seed=_JUDGE_SEED)
    shown_vertices, shown = (posed, faces) if options.damage == "clean" else cut_ball(posed, faces, rng)
    shown_frame = UnitFrame.of(shown_vertices, shown)
    shown_unit = shown_frame.to_unit(shown_vertices)

    def errors(planes: FloatArray) -> list[float]:
        return [surface.mean_squared_distance(reflect(judge, plane)) for plane in planes]

    def judged(raw: FloatArray) -> dict[str, Any]:
        # From the shown shape's unit frame to the intact one's; both are rotated alike.
        planes = np.array([shown_frame.plane_to_input(plane) for plane in raw])
        raw_errors = errors(planes)
        return {"raw": raw_errors, **_against(truth, planes, raw_errors)}

    result.methods[PCA] = judged(pca_planes(shown_unit, shown))
    for name, detector in _detectors(options.weights).items():
        figures = judged(detector.propose(shown_unit, shown).planes)
        detection = detector.detect((shown_vertices, shown), mode="paper")
        accepted = np.array([np.append(plane.normal, plane.offset) for plane in detection.planes]).reshape(-1, 4)
        figures["validated"] = errors(accepted)
        figures["axes"] = len(detection.axes)
        result.methods[name] = figures
    return result


def _written_planes(path: Path, frame: UnitFrame) -> list[list[float]]:
    """Planes that `training shapes` wrote down for a file, in its unit frame; empty where none are known.

    Of a continuous family the file lists none, so such shapes are left to the search.
    """
    written = written_truth(path, frame)
    if written is None or any(axis.order is None for axis in written[0].axes):
        return []
    return written[0].planes.tolist()


def _against(truth: FloatArray, planes: FloatArray, errors: list[float]) -> dict[str, Any]:
    """GTE and angle of the best plane to its nearest reference plane; share of the reference planes found."""
    if not len(truth):
        return {}
    cosines = np.clip(np.abs(planes[:, :3] @ truth[:, :3].T), 0.0, 1.0)
    signs = np.where(planes[:, :3] @ truth[:, :3].T >= 0, 1.0, -1.0)
    shifts = np.abs(planes[:, 3:] - signs * truth[:, 3])
    gte = 2.0 - 2.0 * cosines + shifts**2
    best = int(np.argmin(errors))
    angles = np.degrees(np.arccos(cosines))
    found = (angles < 1.0) & (shifts < 0.01)
    return {
        "gte": float(gte[best].min()),
        "angle": float(angles[best, gte[best].argmin()]),
        "found": int(found.any(0).sum()),
        "clear": len(truth),
    }


def summarise(results: Sequence[ShapeResult], weights: Sequence[str], damage: str) -> dict[str, Any]:
    """Figures per method over all judged shapes: SDE of the best plane, shares as fractions, angles in degrees."""
    done = [result for result in results if result.skipped is None]
    if not done:
        raise ValueError("no shape could be judged")
    clear = [result for result in done if result.clear]
    methods: dict[str, Any] = {}
    for name in (*weights, PCA, UNTRAINED):
        best = np.array([min(result.methods[name]["raw"]) for result in done])
        on_clear = [result.methods[name] for result in clear]
        figures: dict[str, Any] = {
            "best_plane_mean": float(best.mean()),
            "best_plane_median": float(np.median(best)),
            "share_under_threshold": float((best <= MAX_ERROR).mean()),
        }
        if on_clear:
            best_clear = np.array([min(m["raw"]) for m in on_clear])
            figures |= {
                "clear_share_under_threshold": float((best_clear <= MAX_ERROR).mean()),
                "clear_best_plane_mean": float(best_clear.mean()),
                "clear_best_plane_median": float(np.median(best_clear)),
                "gte_mean": _over(on_clear, "gte", np.mean),
                "gte_median": _over(on_clear, "gte", np.median),
                "angle_median": _over(on_clear, "angle", np.median),
                "recall_1_degree": sum(m["found"] for m in on_clear) / sum(m["clear"] for m in on_clear),
            }
        if name != PCA:
            validated = [result.methods[name]["validated"] for result in done]
            figures |= {
                "validated_planes_per_shape": float(np.mean([len(errors) for errors in validated])),
                "validated_share_with_plane": float(np.mean([len(errors) > 0 for errors in validated])),
                "validated_over_threshold": _share_over([error for errors in validated for error in errors]),
            }
            best_validated = [min(errors) for errors in validated if errors]
            if best_validated:
                figures["validated_best_plane_mean"] = float(np.mean(best_validated))
        methods[name] = figures
    return {
        "shapes": len(done),
        "clear": len(clear),
        "skipped": len(results) - len(done),
        "damage": damage,
        "methods": methods,
    }


def _over(rows: Sequence[dict[str, Any]], key: str, statistic: Callable[[Any], Any]) -> float:
    return float(statistic([row[key] for row in rows]))


def _share_over(errors: Sequence[float]) -> float:
    return float(np.mean([error > MAX_ERROR for error in errors])) if errors else 0.0


_COLUMNS = (
    ("share_under_threshold", "raw: shapes with a plane <= 4e-4", "{:.1%}"),
    ("best_plane_mean", "best plane, mean SDE", "{:.2e}"),
    ("best_plane_median", "median", "{:.1e}"),
    ("clear_share_under_threshold", "of clear shapes: <= 4e-4", "{:.1%}"),
    ("clear_best_plane_mean", "best plane, mean SDE", "{:.2e}"),
    ("gte_mean", "GTE mean", "{:.2e}"),
    ("gte_median", "GTE median", "{:.1e}"),
    ("angle_median", "angle, median degrees", "{:.2g}"),
    ("recall_1_degree", "clear planes within 1 deg", "{:.1%}"),
    ("validated_share_with_plane", "validated: shapes with a plane", "{:.1%}"),
    ("validated_planes_per_shape", "planes a shape", "{:.2f}"),
    ("validated_best_plane_mean", "best plane, mean SDE", "{:.2e}"),
    ("validated_over_threshold", "planes over 4e-4 on fresh samples", "{:.1%}"),
)


def render(report: dict[str, Any]) -> str:
    """The report as a Markdown table, one row a method."""
    header = "| method | " + " | ".join(title for _, title, _ in _COLUMNS) + " |"
    lines = [
        f"{report['shapes']} shapes ({report['clear']} with a clear plane), {report['damage']}, random poses",
        "",
        header,
        "| --- |" + " --- |" * len(_COLUMNS),
    ]
    for name, figures in report["methods"].items():
        cells = [form.format(figures[key]) if key in figures else "" for key, _, form in _COLUMNS]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)
