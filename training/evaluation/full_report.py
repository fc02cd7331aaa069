"""Records of `training.evaluation.full_evaluation` summed up and written as Markdown tables, one row a method.

What the columns say:

- *clear planes*, *clear axes*: share of the true elements with an SDE under 1e-6 that were found (`matching`);
  *with order*: the axis' order is right too.
- *dominant plane*: share of the shapes with a clear plane where the best plane returned is one of them.
- *..., within max_error as shown*: the same, only of planes whose SDE on the mesh as it is shown stays within the
  threshold. A hole has an SDE of its own: with it even the true plane may exceed what a detector is allowed to return.
- *angle*: degrees between clear planes and what they were found by.
- *over max_error*: share of all returned elements that exceed the threshold on fresh samples of the mesh shown.
- *false, asymmetric*: returned elements a shape, on shapes of which the search lists nothing at all within 4e-4.
- *group*: share of the procedural shapes whose point group is named right; elements that hold within the threshold only
  count for a detector, so that an irregular solid that is nearly symmetric may be named Cs.
- *exact, C1 and Ci*: elements called exact a shape, on procedural shapes that have neither plane nor axis.
- *not listed*: returned elements a shape, on all shapes that were searched, that the search does not list.
- *best plane*: SDE on the intact mesh of the best plane returned. A shape that got none counts with the threshold, so
  that saying nothing does not pay. Over shapes with a clear plane, and over shapes of which the truth lists any plane.
- *ms*: CPU milliseconds, half and 95 % of the shapes stay below; on files of 3,000 to 6,000 faces besides.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from training.evaluation.full_methods import TITLES

MIDDLE_FACES = (3000, 6000)
"""Files of about 4,500 faces, the size the design's targets speak of."""

_COLUMNS = (
    ("shapes", "shapes", "{:d}"),
    ("plane_recall", "clear planes", "{:.1%}"),
    ("dominant_share", "dominant plane", "{:.1%}"),
    ("plane_recall_shown", "clear planes within max_error as shown", "{:.1%}"),
    ("dominant_share_shown", "dominant plane, if one is", "{:.1%}"),
    ("any_share", "any clear plane", "{:.1%}"),
    ("axis_recall", "clear axes", "{:.1%}"),
    ("order_recall", "with order", "{:.1%}"),
    ("angle_median", "angle, median °", "{:.2g}"),
    ("angle_p95", "95 %", "{:.2g}"),
    ("over_threshold", "over max_error", "{:.2%}"),
    ("false_per_asymmetric", "false, asymmetric", "{:.2f}"),
    ("group_share", "group", "{:.1%}"),
    ("exact_per_c1", "exact, C1 and Ci", "{:.2f}"),
    ("unlisted_per_shape", "not listed", "{:.2f}"),
    ("best_clear_mean", "best plane, clear: mean SDE", "{:.1e}"),
    ("best_clear_median", "median", "{:.1e}"),
    ("best_mean", "best plane, all: mean SDE", "{:.1e}"),
    ("best_median", "median", "{:.1e}"),
    ("ms_p50", "ms p50", "{:.1f}"),
    ("ms_p95", "ms p95", "{:.1f}"),
    ("ms_middle_p50", "ms p50, 3k-6k faces", "{:.1f}"),
)
_ABLATION_COLUMNS = (
    "shapes",
    "plane_recall",
    "dominant_share",
    "axis_recall",
    "order_recall",
    "ms_p50",
    "ms_middle_p50",
)


def summarise(records: Sequence[Mapping[str, Any]], max_error: float) -> dict[str, Any]:
    """Figures over all judged shapes, and per method (``methods``); a figure nothing was there for is left out.

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
    clear = [said for record, said in pairs if record["clear_planes"]]
    shown = [pair for record, said in pairs for pair in zip(said["planes_found"], record["shown_sde"], strict=True)]
    fresh = [error for _, said in pairs for error in said["fresh_sde"]]
    figures: dict[str, Any] = {
        "shapes": len(pairs),
        "plane_recall": _mean(found for said in clear for found in said["planes_found"]),
        "dominant_share": _mean(said["dominant"] for said in clear),
        "plane_recall_shown": _mean(found for found, error in shown if error <= max_error),
        "dominant_share_shown": _mean(
            said["dominant"] for record, said in pairs if min(record["shown_sde"], default=np.inf) <= max_error
        ),
        "any_share": _mean(any(said["planes_found"]) for said in clear),
        "axis_recall": _mean(found for _, said in pairs for found in said["axes_found"]),
        "order_recall": _mean(found for _, said in pairs for found in said["orders_found"]),
        "over_threshold": _mean(error > max_error for error in fresh),
        "false_per_asymmetric": _mean(_returned(said) for record, said in pairs if _asymmetric(record)),
        "group_share": _mean(
            said["point_group"] == record["group"]
            for record, said in pairs
            if record.get("group") and said["point_group"]
        ),
        "exact_per_c1": _mean(
            sum(said["exact"])
            for record, said in pairs
            if record.get("group") in ("C1", "Ci") and said["exact"] is not None
        ),
        "unlisted_per_shape": _mean(said["unlisted"] for record, said in pairs if record.get("group") is None),
        "stages_p50": _stages([said["stages"] for _, said in pairs]),
    }
    angles = [angle for _, said in pairs for angle in said["angles"]]
    best_clear = [min(said["plane_sde"], default=max_error) for said in clear]
    best = [min(said["plane_sde"], default=max_error) for record, said in pairs if record["truth_planes"]]
    times = [said["ms"] for _, said in pairs]
    middle = [said["ms"] for record, said in pairs if MIDDLE_FACES[0] <= record["faces"] <= MIDDLE_FACES[1]]
    figures["best_clear_mean"], figures["best_mean"] = _mean(best_clear), _mean(best)
    for key, values, percent in (
        ("angle_median", angles, 50), ("angle_p95", angles, 95), ("best_clear_median", best_clear, 50),
        ("best_median", best, 50), ("ms_p50", times, 50), ("ms_p95", times, 95), ("ms_middle_p50", middle, 50),
        ("ms_middle_p95", middle, 95),
    ):  # fmt: skip
        figures[key] = float(np.percentile(values, percent)) if values else None
    return {key: value for key, value in figures.items() if value is not None}


def _returned(said: Mapping[str, Any]) -> int:
    return len(said["planes"]) + len(said["axes"])


def _mean(values: Iterable[float]) -> float | None:
    listed = list(values)
    return float(np.mean(listed)) if listed else None


def _stages(stages: Sequence[Mapping[str, float]]) -> dict[str, float]:
    names = dict.fromkeys(name for stage in stages for name in stage)
    return {name: float(np.median([stage[name] for stage in stages if name in stage])) for name in names}


def render(report: Mapping[str, Any], damage: str, *, ablation: bool = False) -> str:
    """A report of `summarise` as Markdown: a line on the shapes, the table, and the stages of full mode.

    With ``ablation`` the rows are sets of proposal sources and only the columns that weigh them are shown.
    """
    methods = {name: of for name, of in report["methods"].items() if ablation == name.startswith("full[")}
    columns = [column for column in _COLUMNS if not ablation or column[0] in _ABLATION_COLUMNS]
    present = {key for of in methods.values() for key in of}
    columns = [column for column in columns if column[0] in present]
    lost = report["clear_planes"] - report["clear_shown"]
    if not lost:  # both ways of counting are one
        columns = [column for column in columns if not column[0].endswith("_shown")]
    middle = ""
    if report["middle"]:
        middle = f"; {report['middle']} of 3,000 to 6,000 faces, median {report['middle_faces_median']:.0f}"
    lines = [
        f"{report['shapes']} shapes, {damage}: {report['clear']} with {report['clear_planes']} clear planes"
        f"{f' ({lost} of them over max_error as shown)' if lost else ''}, "
        f"{report['clear_axes']} clear axes, {report['asymmetric']} without any within 4e-4{middle}",
        "",
        "| method | " + " | ".join(title for _, title, _ in columns) + " |",
        "| --- |" + " --- |" * len(columns),
    ]
    for name, figures in methods.items():
        cells = [form.format(figures[key]) if key in figures else "" for key, _, form in columns]
        lines.append(f"| {TITLES.get(name, name)} | " + " | ".join(cells) + " |")
    if not ablation:
        for name, figures in methods.items():
            if figures["stages_p50"]:
                stages = ", ".join(f"{stage} {spent:.1f}" for stage, spent in figures["stages_p50"].items())
                lines += ["", f"{TITLES.get(name, name)}, median wall-clock milliseconds a stage: {stages}"]
    return "\n".join(lines)
