"""A report of `training.evaluation.report` for a terminal: figures one below the other, methods side by side."""

from collections.abc import Mapping, Sequence
from typing import Any

from training.evaluation.report import BEST_PLANE, Column, heading, symmetry_columns

_BETWEEN = "  "


def render_plain(report: Mapping[str, Any], damage: str, max_error: float) -> str:
    """The same figures as `report.render`, in columns that are as wide as they need to be."""
    methods = report["methods"]
    lines = [heading(report, damage, max_error)]
    for title, columns in (("Best plane", BEST_PLANE), ("All symmetries", symmetry_columns(report))):
        lines += ["", *_block(title, methods, columns)]
    for figures in methods.values():
        if figures["stages_p50"]:
            stages = ", ".join(f"{stage} {spent:.1f}" for stage, spent in figures["stages_p50"].items())
            lines += ["", f"{figures['title']}: median wall-clock milliseconds a stage: {stages}"]
    return "\n".join(lines)


def _block(title: str, methods: Mapping[str, Mapping[str, Any]], columns: Sequence[Column]) -> list[str]:
    """A row for every figure that some method has, a column for every method."""
    rows = [[title, *(str(figures["title"]) for figures in methods.values())]]
    for key, name, form in columns:
        if any(key in figures for figures in methods.values()):
            cells = (form.format(figures[key]) if key in figures else "-" for figures in methods.values())
            rows.append([f"{_BETWEEN}{name}", *cells])
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return [
        _BETWEEN.join(
            [row[0].ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True))]
        ).rstrip()
        for row in rows
    ]
