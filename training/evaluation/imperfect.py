"""Whether the point group of imperfect shapes is told: procedural shapes of known group, imperfect in many ways."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from model import Detection, Mesh
from model.errors import PRSNetError
from model.search.point_groups import point_group
from training.evaluation.calibration import expected_calibration_error
from training.evaluation.detectors import loaded
from training.evaluation.imperfections import KINDS
from training.evaluation.matching import Found, FoundAxis, match
from training.oracle.truth import Truth, TruthAxis
from training.parallel import spread
from training.shapes.catalogue import KnownShape, families, generate, posed
from training.shapes.solids import random_rotation


@dataclass(frozen=True, slots=True)
class Result:
    """One detection: ``right``, the group is that of the shape before; ``agrees``, the answer with itself.

    ``elements`` of the shape, ``found`` of them; ``false`` ones returned. ``confidence`` told of the answer, None of
    C1. ``told``: the levels, with the RMS deviation that each needs in thousandths of the unit frame.
    """

    kind: str
    family: str
    group: str
    answer: str
    agrees: bool
    elements: int
    found: int
    false: int
    confidence: float | None
    milliseconds: float
    told: str

    @property
    def right(self) -> bool:
        """Whether the answer is the group of the shape before."""
        return self.group == self.answer


@dataclass(frozen=True, slots=True)
class _Job:
    family: str
    number: int
    kinds: tuple[str, ...]
    seed: int


def run(
    names: Sequence[str] = (), *, shapes: int = 1, seed: int = 0, workers: int = 1, progress: bool = True
) -> list[Result]:
    """Detect ``shapes`` random members of every family in every kind of imperfection, or those of ``names``.

    Raises:
        ValueError: a name is neither a family nor a kind.
    """
    unknown = [name for name in names if name not in KINDS and name not in families()]
    if unknown:
        raise ValueError(f"{unknown[0]} is neither a family nor a kind: {', '.join([*KINDS, *families()])}")
    kinds = tuple(kind for kind in KINDS if kind in names) or tuple(KINDS)
    chosen = [family for family in families() if family in names] or list(families())
    jobs = [_Job(family, number, kinds, seed) for family in chosen for number in range(shapes)]
    results = tqdm(spread(_detect, jobs, workers), total=len(jobs), unit="shape", disable=not progress)
    return [result for several in results for result in several]


def _detect(job: _Job) -> list[Result]:
    detector = loaded()
    number = families().index(job.family)
    shape = generate(job.family, np.random.default_rng([job.seed, number, job.number]))
    results: list[Result] = []
    for kind in job.kinds:
        rng = np.random.default_rng([job.seed, number, job.number, list(KINDS).index(kind)])
        shown = posed(shape, random_rotation(rng), rng.normal(size=3))
        diagonal = float(np.linalg.norm(np.ptp(shown.vertices[np.unique(shown.faces)], axis=0)))
        try:
            mesh = Mesh.checked(*KINDS[kind](shown.vertices, shown.faces, rng, diagonal))
            detection = detector.detect(mesh)
        except PRSNetError:
            continue  # some thin shapes do not survive decimation
        results.append(_result(kind, shown, detection))
    return results


def _result(kind: str, shown: KnownShape, detection: Detection) -> Result:
    # Both in the unit frame of what was shown; its scale serves for the truth as well.
    centre, scale = detection.center, detection.scale
    planes = np.column_stack([shown.planes[:, :3], (shown.planes[:, 3] + shown.planes[:, :3] @ centre) / scale])
    axes = [TruthAxis(axis.direction, (axis.point - centre) / scale, axis.order, 0.0) for axis in shown.axes]
    truth = Truth(centre, scale, planes, np.zeros(len(planes)), np.zeros(len(planes), dtype=np.bool_), axes)
    found = Found(
        np.array([[*p.normal, (p.offset + p.normal @ centre) / scale] for p in detection.planes]).reshape(-1, 4),
        [FoundAxis(axis.direction, (axis.point - centre) / scale, axis.order) for axis in detection.axes],
    )
    matches = match(truth, found)
    group = point_group(detection.point_group)
    orders = Counter(axis.order or 0 for axis in detection.axes)
    chosen = [level for level in detection.levels if level.chosen]
    return Result(
        kind=kind,
        family=shown.name,
        group=shown.point_group,
        answer=detection.point_group,
        agrees=len(detection.planes) == len(group.normals) and orders == Counter(group.orders),
        elements=len(planes) + len(axes),
        found=int(matches.planes.sum() + matches.orders.sum()),
        false=int((~matches.true_planes).sum() + (~matches.true_axes).sum()),
        confidence=chosen[0].confidence if chosen else None,
        milliseconds=detection.timings_ms["total"],
        told=", ".join(f"{each.point_group} {1e3 * each.rms_distance / scale:.2f}" for each in detection.levels),
    )


def render(results: Sequence[Result]) -> str:
    """A table by kind, and what was answered where the group is wrong."""
    lines = ["| imperfection | group right | agrees | elements found | false elements a shape | p50 ms | p95 ms |"]
    lines += ["| --- | --- | --- | --- | --- | --- | --- |"]
    kinds = [kind for kind in KINDS if any(result.kind == kind for result in results)]
    for kind in [*kinds, "all"]:
        rows = [result for result in results if kind in (result.kind, "all")]
        count, elements = len(rows), sum(row.elements for row in rows)
        spent = [row.milliseconds for row in rows]
        lines.append(
            f"| {kind} | {sum(row.right for row in rows)} of {count} | {sum(row.agrees for row in rows)} | "
            f"{100 * sum(row.found for row in rows) / max(elements, 1):.1f} % | "
            f"{sum(row.false for row in rows) / max(count, 1):.2f} | "
            f"{np.median(spent):.0f} | {np.percentile(spent, 95):.0f} |"
        )
    sure = [row for row in results if row.confidence is not None]
    told = np.array([row.confidence for row in sure], dtype=np.float64)
    if len(sure):
        error = expected_calibration_error(told, np.array([row.false == 0 for row in sure]))
        lines += ["", f"Expected calibration error (no false element): {error:.3f}"]
    wrong = [f"- {r.kind}, {r.family}: {r.group} -> {r.answer}  [{r.told}]" for r in results if not r.right]
    return "\n".join([*lines, "", *wrong])
