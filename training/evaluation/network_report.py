"""Records of `training.evaluation.networks` summed up and written as a Markdown table, one row a method.

What the columns say:

- *raw: <= 4e-4*: share of all shapes of which some plane has an SDE within the paper's threshold, as it leaves the
  network; *best plane*: SDE of the best one a shape.
- *clear: ...*: the same over the shapes that have a clear plane (SDE under 1e-6).
- *GTE*, *angle*: of the best plane against the closest clear one (`training.evaluation.matching.nearest_clear_plane`).
  Of a shape that also has nearly true planes the best may be one of those, and far from any clear one; *closest plane*
  takes the head with the smallest GTE instead.
- *clear planes, 1°* and *5°*: share of all clear planes that some head met; three heads cannot meet more than three.
- *axes, 5°*: the same of the clear axes and the rotation heads.
- *validated*: what paper mode returns. *over 4e-4* counts on fresh samples of the intact shape.
- *ms*: median CPU milliseconds of the network, all frames and passes it needs.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from model.paper.validation import MAX_ERROR

_COLUMNS = (
    ("share", "raw: <= 4e-4", "{:.1%}"),
    ("best_mean", "best plane, mean SDE", "{:.2e}"),
    ("best_median", "median", "{:.1e}"),
    ("clear_share", "clear: <= 4e-4", "{:.1%}"),
    ("clear_best_mean", "best plane, mean SDE", "{:.2e}"),
    ("gte_mean", "GTE mean", "{:.2e}"),
    ("gte_median", "GTE median", "{:.1e}"),
    ("gte_closest", "GTE mean, closest plane", "{:.2e}"),
    ("angle_median", "angle, median °", "{:.2g}"),
    ("recall_1", "clear planes, 1°", "{:.1%}"),
    ("recall_5", "5°", "{:.1%}"),
    ("axes_5", "axes, 5°", "{:.1%}"),
    ("validated_share", "validated: with a plane", "{:.1%}"),
    ("validated_planes", "planes a shape", "{:.2f}"),
    ("validated_over", "over 4e-4", "{:.1%}"),
    ("ms", "ms", "{:.1f}"),
)


def summarise(records: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Figures over all judged shapes: ``shapes``, ``clear``, ``skipped`` and ``methods``, a dictionary each.

    Shares are fractions, angles degrees; a figure nothing was there for is left out.

    Raises:
        ValueError: no shape could be judged.
    """
    done = [record for record in records if "skipped" not in record]
    if not done:
        raise ValueError("no shape could be judged")
    names = dict.fromkeys(name for record in done for name in record["methods"])
    return {
        "shapes": len(done),
        "clear": sum(record["clear_planes"] > 0 for record in done),
        "skipped": len(records) - len(done),
        "methods": {name: _figures(done, name) for name in names},
    }


def _figures(done: Sequence[Mapping[str, Any]], name: str) -> dict[str, float]:
    pairs = [(record, record["methods"][name]) for record in done]
    best = np.array([min(said["raw"]) for _, said in pairs])
    figures: dict[str, float] = {
        "share": float((best <= MAX_ERROR).mean()),
        "best_mean": float(best.mean()),
        "best_median": float(np.median(best)),
    }
    clear = [(record, said) for record, said in pairs if record["clear_planes"]]
    if clear:
        best = np.array([min(said["raw"]) for _, said in clear])
        planes = sum(record["clear_planes"] for record, _ in clear)
        figures |= {
            "clear_share": float((best <= MAX_ERROR).mean()),
            "clear_best_mean": float(best.mean()),
            "clear_best_median": float(np.median(best)),
            "gte_mean": float(np.mean([said["gte"] for _, said in clear])),
            "gte_median": float(np.median([said["gte"] for _, said in clear])),
            "gte_closest": float(np.mean([said["gte_closest"] for _, said in clear])),
            "angle_median": float(np.median([said["angle"] for _, said in clear])),
            "recall_1": sum(said["found"][0] for _, said in clear) / planes,
            "recall_5": sum(said["found"][1] for _, said in clear) / planes,
        }
    if "ms" not in pairs[0][1]:
        return figures
    axes = sum(record["clear_axes"] for record, _ in pairs)
    if axes:
        figures["axes_1"] = sum(said["axes"][0] for _, said in pairs) / axes
        figures["axes_5"] = sum(said["axes"][1] for _, said in pairs) / axes
    validated = [error for _, said in pairs for error in said["validated"]]
    return figures | {
        "validated_share": float(np.mean([bool(said["validated"]) for _, said in pairs])),
        "validated_planes": len(validated) / len(pairs),
        "validated_over": float(np.mean([error > MAX_ERROR for error in validated])) if validated else 0.0,
        "ms": float(np.median([said["ms"] for _, said in pairs])),
    }


def render(report: Mapping[str, Any], damage: str) -> str:
    """A report of `summarise` as Markdown: a line on the shapes and the table."""
    present = {key for figures in report["methods"].values() for key in figures}
    columns = [column for column in _COLUMNS if column[0] in present]
    lines = [
        f"{report['shapes']} shapes ({report['clear']} with a clear plane), {damage}",
        "",
        "| method | " + " | ".join(title for _, title, _ in columns) + " |",
        "| --- |" + " --- |" * len(columns),
    ]
    for name, figures in report["methods"].items():
        cells = [form.format(figures[key]) if key in figures else "" for key, _, form in columns]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)
