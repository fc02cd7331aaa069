"""Records of `training.evaluation.judging` summed up, and written as Markdown, one row a method.

Two tables: how accurate the best plane is, and how complete the answer is. What the columns say:

*Best plane.* All errors on the intact shape, on samples no method has seen. A shape that got no plane counts with the
threshold (and a GTE of 2, that of a plane at a right angle), so that returning nothing does not pay.

- *a plane <= t*: share of the shapes for which some returned plane has an SDE within the threshold ``max_error``.
- *mean SDE*, *median*: of the best plane a shape; over all shapes, and over those with a clear plane (SDE under 1e-6).
- *GTE*, *angle*: of the best plane against the closest clear one (`matching.nearest_clear_plane`). Of a shape that also
  has nearly true planes the best may be one of those, and far from any clear one; *closest plane* takes the returned
  plane with the smallest GTE instead.
- *a plane <= 5°*, *<= 15°*: share of the shapes with a clear plane that got one whose normal is so close to that of a
  clear one, wherever it lies.
- *completion*: distance, unit frame, of the missing part from what mirroring puts in its place (the paper's
  application), by the returned plane that does so best (one about which the hole itself is symmetric fills nothing),
  root-mean-square a shape; over the shapes whose missing part has a mirror image at all. No plane counts 1.
- *surface shown*: share of the intact surface within 2 % of its diameter of the mesh as shown; *completed*: of that or
  of its mirror image in the first plane returned, as `/complete` would make it (nothing is added without a plane);
  *false*: share of the mirror image that is 2 % off the intact surface; *by all*, *false*: mirrored in every plane
  returned; *completable*: in the best clear plane. Over the shapes with a clear plane, where something is missing.
- *planes a shape*, *mean SDE returned*, *over t*: of all planes returned; the last on fresh samples of the mesh shown,
  axes included. *closest two*: the smallest angle between two planes returned for a shape, of
  those that got two.
- *ms*: CPU milliseconds, half and 95 % of the shapes stay below; on files of 3,000 to 6,000 faces besides.

*All symmetries.*

- *clear planes*, *clear axes*: share of the true elements with an SDE under 1e-6 that were found (`matching`), and
  within 5° and 0.05; *with order*: the axis' order is right too.
- *dominant plane*: share of the shapes with a clear plane where the first plane returned is one of them.
- *mAP*: as the SHREC 2023 protocol has it: over the planes returned, in their order, that match a true one no earlier
  one has matched, the mean share of right ones up to there; 0 where none is right. It does not see what is missing:
  that is *clear planes*. Their PHC, of the first plane alone, is *dominant plane*.
- *..., within t as shown*: the same, only of planes whose SDE on the mesh as it is shown stays within the threshold. A
  hole has an SDE of its own: with it even the true plane may exceed what a detector is allowed to return.
- *angle*: degrees between clear planes and what they were found by.
- *false, asymmetric*: returned elements a shape, on shapes of which the search lists nothing at all within 4e-4.
- *group*: share of the procedural shapes whose point group is named right; elements that hold within the threshold only
  count for a detector, so that an irregular solid that is nearly symmetric may be named Cs.
- *exact, C1 and Ci*: elements called exact a shape, on procedural shapes that have neither plane nor axis.
- *not listed*: returned elements a shape, on all shapes that were searched, that the search does not list.
"""

from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from training.evaluation.matching import angle_between

MIDDLE_FACES = (3000, 6000)
"""Files of about 4,500 faces, the size the design's targets speak of."""

MISSING_GTE = 2.0
"""Of a shape that got no plane: the squared difference of two normals at a right angle."""

COMPLETABLE = 1e-3
"""The missing part has a mirror image when the best clear plane completes it to within this, unit frame."""

Column = tuple[str, str, str]
"""The key of a figure, the column's title, and how a cell is formatted."""

BEST_PLANE: tuple[Column, ...] = (
    ("shapes", "shapes", "{:d}"),
    ("share", "a plane <= t", "{:.1%}"),
    ("best_mean", "best plane, mean SDE", "{:.2e}"),
    ("best_median", "median", "{:.1e}"),
    ("clear_share", "clear: a plane <= t", "{:.1%}"),
    ("clear_best_mean", "best plane, mean SDE", "{:.2e}"),
    ("clear_best_median", "median", "{:.1e}"),
    ("gte_mean", "GTE mean", "{:.2e}"),
    ("gte_median", "GTE median", "{:.1e}"),
    ("gte_closest", "GTE mean, closest plane", "{:.2e}"),
    ("gte_angle", "angle, median °", "{:.2g}"),
    ("within_5", "a plane <= 5°", "{:.1%}"),
    ("within_15", "<= 15°", "{:.1%}"),
    ("completion", "completion, mean error", "{:.2e}"),
    ("surface_before", "surface shown", "{:.1%}"),
    ("surface_after", "completed", "{:.1%}"),
    ("surface_wrong", "false", "{:.1%}"),
    ("surface_all", "by all", "{:.1%}"),
    ("surface_all_wrong", "false", "{:.1%}"),
    ("surface_possible", "completable", "{:.1%}"),
    ("planes", "planes a shape", "{:.2f}"),
    ("apart", "closest two, median °", "{:.2g}"),
    ("returned_mean", "mean SDE returned", "{:.2e}"),
    ("over_threshold", "over t", "{:.2%}"),
    ("ms_p50", "ms p50", "{:.1f}"),
    ("ms_p95", "ms p95", "{:.1f}"),
    ("ms_middle_p50", "ms p50, 3k-6k faces", "{:.1f}"),
)
ALL_SYMMETRIES: tuple[Column, ...] = (
    ("plane_recall", "clear planes", "{:.1%}"),
    ("planes_roughly", "within 5°", "{:.1%}"),
    ("dominant_share", "dominant plane", "{:.1%}"),
    ("plane_recall_shown", "clear planes within t as shown", "{:.1%}"),
    ("dominant_share_shown", "dominant plane, if one is", "{:.1%}"),
    ("mean_precision", "mAP", "{:.1%}"),
    ("any_share", "any clear plane", "{:.1%}"),
    ("axis_recall", "clear axes", "{:.1%}"),
    ("axes_roughly", "within 5°", "{:.1%}"),
    ("order_recall", "with order", "{:.1%}"),
    ("angle_median", "angle, median °", "{:.2g}"),
    ("angle_p95", "95 %", "{:.2g}"),
    ("false_per_asymmetric", "false, asymmetric", "{:.2f}"),
    ("group_share", "group", "{:.1%}"),
    ("exact_per_c1", "exact, C1 and Ci", "{:.2f}"),
    ("unlisted_per_shape", "not listed", "{:.2f}"),
)


def summarise(records: Sequence[Mapping[str, Any]], max_error: float) -> dict[str, Any]:
    """Figures over all judged shapes, and per method (``methods``); a figure nothing was there for is left out.

    Shares are fractions, angles degrees.

    Raises:
        ValueError: no shape could be judged.
    """
    done = [record for record in records if "skipped" not in record]
    if not done:
        raise ValueError("no shape could be judged")
    methods = dict.fromkeys(method for record in done for method in record["methods"])
    middle = [record for record in done if MIDDLE_FACES[0] <= record["faces"] <= MIDDLE_FACES[1]]
    return {
        "shapes": len(done),
        "skipped": len(records) - len(done),
        "clear": sum(record["clear_planes"] > 0 for record in done),
        "clear_planes": sum(record["clear_planes"] for record in done),
        "clear_shown": sum(error <= max_error for record in done for error in record["shown_sde"]),
        "clear_axes": sum(record["clear_axes"] for record in done),
        "asymmetric": sum(_asymmetric(record) for record in done),
        "procedural": sum(record.get("group") is not None for record in done),
        "middle": len(middle),
        "middle_faces_median": float(np.median([record["faces"] for record in middle])) if middle else None,
        "methods": {method: _figures(done, method, max_error) for method in methods},
    }


def _asymmetric(record: Mapping[str, Any]) -> bool:
    """Known by the search. What a procedural shape of the group C1 resembles within 4e-4 nobody has written down."""
    return record["listed"] == 0 and record.get("group") is None


def _figures(done: Sequence[Mapping[str, Any]], method: str, max_error: float) -> dict[str, Any]:
    pairs = [(record, record["methods"][method]) for record in done if method in record["methods"]]
    figures: dict[str, Any] = {"title": pairs[0][1]["title"], "shapes": len(pairs)}
    figures |= _best_plane(pairs, max_error) | _completion(pairs) | _completeness(pairs, max_error)
    figures["stages_p50"] = _stages([answer["stages"] for _, answer in pairs])
    return {key: value for key, value in figures.items() if value is not None}


Pairs = Sequence[tuple[Mapping[str, Any], Mapping[str, Any]]]
"""Records of shapes, and of what a method answered."""


def _best_plane(pairs: Pairs, max_error: float) -> dict[str, Any]:
    def best_errors(answers: Iterable[Mapping[str, Any]]) -> list[float]:
        return [min(answer["plane_sde"], default=max_error) for answer in answers]

    def symmetric(answers: Iterable[Mapping[str, Any]]) -> float | None:
        return _mean(min(answer["plane_sde"], default=np.inf) <= max_error for answer in answers)

    every = [answer for _, answer in pairs]
    clear = [answer for record, answer in pairs if record["clear_planes"]]
    gte = [MISSING_GTE if answer["gte"] is None else answer["gte"] for answer in clear]
    closest = [MISSING_GTE if answer["gte_closest"] is None else answer["gte_closest"] for answer in clear]
    # Records of reports that are older than this column do not have it.
    closest_angles = [answer["closest_angle"] for answer in clear if "closest_angle" in answer]
    times = [answer["ms"] for answer in every]
    middle = [answer["ms"] for record, answer in pairs if MIDDLE_FACES[0] <= record["faces"] <= MIDDLE_FACES[1]]
    return {
        "share": symmetric(every),
        "best_mean": _mean(best_errors(every)),
        "best_median": _percentile(best_errors(every), 50),
        "clear_share": symmetric(clear),
        "clear_best_mean": _mean(best_errors(clear)),
        "clear_best_median": _percentile(best_errors(clear), 50),
        "gte_mean": _mean(gte),
        "gte_median": _percentile(gte, 50),
        "gte_closest": _mean(closest),
        "gte_angle": _percentile([answer["gte_angle"] for answer in clear if answer["gte_angle"] is not None], 50),
        "within_5": _mean(angle is not None and angle <= 5.0 for angle in closest_angles),
        "within_15": _mean(angle is not None and angle <= 15.0 for angle in closest_angles),
        "completion": _mean(
            1.0 if answer["completion"] is None else answer["completion"]
            for record, answer in pairs
            if record["completion_possible"] is not None
            and record["completion_possible"] <= COMPLETABLE
            and "completion" in answer
        ),
        "planes": _mean(len(answer["planes"]) for answer in every),
        "apart": _percentile([_apart(answer["planes"]) for answer in every if len(answer["planes"]) > 1], 50),
        "returned_mean": _mean(error for answer in every for error in answer["plane_sde"]),
        "over_threshold": _mean(error > max_error for answer in every for error in answer["fresh_sde"]),
        "ms_p50": _percentile(times, 50),
        "ms_p95": _percentile(times, 95),
        "ms_middle_p50": _percentile(middle, 50),
    }


def _apart(planes: Sequence[Sequence[float]]) -> float:
    """The smallest angle, degrees, between the normals of two of the planes."""
    normals = np.array(planes)[:, :3]
    return min(angle_between(first, second) for first, second in combinations(normals, 2))


def _completion(pairs: Pairs) -> dict[str, Any]:
    """How much of the intact surface there is before and after mirroring; nothing where nothing is missing."""
    # Records of reports that are older than these columns do not have them.
    clear = [pair for pair in pairs if pair[0]["clear_planes"] and "surface_all" in pair[1]]
    if all(record["surface_before"] == 1.0 for record, _ in clear):
        return {}
    return {
        **{key: _mean(record[key] for record, _ in clear) for key in ("surface_before", "surface_possible")},
        **{
            key: _mean(answer[key] for _, answer in clear)
            for key in ("surface_after", "surface_wrong", "surface_all", "surface_all_wrong")
        },
    }


def _completeness(pairs: Pairs, max_error: float) -> dict[str, Any]:
    clear = [answer for record, answer in pairs if record["clear_planes"]]
    shown = [pair for record, answer in pairs for pair in zip(answer["planes_found"], record["shown_sde"], strict=True)]
    angles = [angle for _, answer in pairs for angle in answer["angles"]]
    planes, axes = (sum(record[key] for record, _ in pairs) for key in ("clear_planes", "clear_axes"))
    has_axes = any(answer["axes"] for _, answer in pairs)
    return {
        "plane_recall": _mean(found for answer in clear for found in answer["planes_found"]),
        "planes_roughly": sum(answer["planes_roughly"] for answer in clear) / planes if planes else None,
        "dominant_share": _mean(answer["dominant"] for answer in clear),
        "mean_precision": _mean(average_precision(answer["matches"]) for answer in clear),
        "plane_recall_shown": _mean(found for found, error in shown if error <= max_error),
        "dominant_share_shown": _mean(
            answer["dominant"] for record, answer in pairs if min(record["shown_sde"], default=np.inf) <= max_error
        ),
        "any_share": _mean(any(answer["planes_found"]) for answer in clear),
        "axis_recall": _mean(found for _, answer in pairs for found in answer["axes_found"]) if has_axes else None,
        "axes_roughly": sum(answer["axes_roughly"] for _, answer in pairs) / axes if axes and has_axes else None,
        "order_recall": _mean(found for _, answer in pairs for found in answer["orders_found"]) if has_axes else None,
        "angle_median": _percentile(angles, 50),
        "angle_p95": _percentile(angles, 95),
        "false_per_asymmetric": _mean(
            len(answer["planes"]) + len(answer["axes"]) for record, answer in pairs if _asymmetric(record)
        ),
        "group_share": _mean(
            answer["point_group"] == record["group"]
            for record, answer in pairs
            if record.get("group") and answer["point_group"]
        ),
        "exact_per_c1": _mean(
            sum(answer["exact"])
            for record, answer in pairs
            if record.get("group") in ("C1", "Ci") and answer["exact"] is not None
        ),
        "unlisted_per_shape": _mean(answer["unlisted"] for record, answer in pairs if record.get("group") is None),
    }


def average_precision(matches: Sequence[bool]) -> float:
    """Of planes in their order: the mean share of right ones up to each right one; 0 where none is right."""
    right = np.flatnonzero(matches)
    return float((np.arange(1, len(right) + 1) / (right + 1)).mean()) if len(right) else 0.0


def _mean(values: Iterable[float]) -> float | None:
    listed = list(values)
    return float(np.mean(listed)) if listed else None


def _percentile(values: Sequence[float], percent: float) -> float | None:
    return float(np.percentile(values, percent)) if values else None


def _stages(stages: Sequence[Mapping[str, float]]) -> dict[str, float]:
    names = dict.fromkeys(name for stage in stages for name in stage)
    return {name: float(np.median([stage[name] for stage in stages if name in stage])) for name in names}


def heading(report: Mapping[str, Any], damage: str, max_error: float) -> str:
    """Which shapes a report of `summarise` is about, in a sentence."""
    lost = report["clear_planes"] - report["clear_shown"]
    middle = ""
    if report["middle"]:
        middle = f"; {report['middle']} of 3,000 to 6,000 faces, median {report['middle_faces_median']:.0f}"
    return (
        f"{report['shapes']} shapes, {damage}, t = {max_error:g}: {report['clear']} with "
        f"{report['clear_planes']} clear planes{f' ({lost} of them over t as shown)' if lost else ''}, "
        f"{report['clear_axes']} clear axes, "
        f"{report['asymmetric']} without any within 4e-4{middle}"
    )


def symmetry_columns(report: Mapping[str, Any]) -> tuple[Column, ...]:
    """The columns of the second table: where no plane is over the threshold, both ways of counting are one."""
    if report["clear_planes"] > report["clear_shown"]:
        return ALL_SYMMETRIES
    return tuple(column for column in ALL_SYMMETRIES if not column[0].endswith("_shown"))


def render(report: Mapping[str, Any], damage: str, max_error: float) -> str:
    """A report of `summarise` as Markdown: a line on the shapes, the two tables, and the stages of detectors."""
    methods = report["methods"]
    lines = [
        heading(report, damage, max_error),
        "",
        table(methods, BEST_PLANE),
        "",
        table(methods, symmetry_columns(report)),
    ]
    for figures in methods.values():
        if figures["stages_p50"]:
            stages = ", ".join(f"{stage} {spent:.1f}" for stage, spent in figures["stages_p50"].items())
            lines += ["", f"{figures['title']}, median wall-clock milliseconds a stage: {stages}"]
    return "\n".join(lines)


def table(methods: Mapping[str, Mapping[str, Any]], columns: Sequence[Column]) -> str:
    """One row a method and those of the ``columns`` that some method has a figure for, as Markdown."""
    present = {key for figures in methods.values() for key in figures}
    columns = [column for column in columns if column[0] in present]
    lines = [
        "| method | " + " | ".join(title for _, title, _ in columns) + " |",
        "| --- |" + " --- |" * len(columns),
    ]
    for figures in methods.values():
        cells = [form.format(figures[key]) if key in figures else "" for key, _, form in columns]
        lines.append(f"| {figures['title']} | " + " | ".join(cells) + " |")
    return "\n".join(lines)
