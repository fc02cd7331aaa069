"""What people want to know of a bulk run: the groups found, what failed and why, what took longest."""

import heapq
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

_SLOWEST = 5
_MOST_GROUPS = 20


@dataclass
class Summary:
    """Counts over all rows of an output, those of earlier runs included."""

    rows: int = 0
    groups: Counter[str] = field(default_factory=Counter[str])
    problems: Counter[str] = field(default_factory=Counter[str])
    examples: dict[str, tuple[str, str]] = field(default_factory=dict[str, tuple[str, str]])
    slowest: list[tuple[float, str]] = field(default_factory=list[tuple[float, str]])
    """Milliseconds and path, smallest first, as `heapq` wants it."""

    @property
    def failed(self) -> int:
        """Rows without an answer."""
        return self.problems.total()

    def add(self, row: Mapping[str, Any]) -> None:
        """Count one row."""
        self.rows += 1
        if (problem := row["problem"]) is None:
            self.groups[row["point_group"]] += 1
        else:
            self.problems[problem] += 1
            self.examples.setdefault(problem, (row["path"], row["detail"]))
        if row["worker_ms"] is not None:
            heapq.heappush(self.slowest, (row["worker_ms"], row["path"]))
            if len(self.slowest) > _SLOWEST:
                heapq.heappop(self.slowest)


def summarise(rows: Iterable[Mapping[str, Any]]) -> Summary:
    """Count all rows."""
    summary = Summary()
    for row in rows:
        summary.add(row)
    return summary


def print_summary(summary: Summary, console: Console) -> None:
    """Print three short tables: point groups, problems with an example each, slowest files."""
    answered = summary.rows - summary.failed
    console.print(f"[bold]{summary.rows}[/bold] meshes, {answered} answered, {summary.failed} not")
    groups = _table("group", "meshes", "share")
    for name, count in summary.groups.most_common(_MOST_GROUPS):
        groups.add_row(name, str(count), f"{count / answered:.1%}")
    if (others := len(summary.groups) - _MOST_GROUPS) > 0:
        groups.add_row(
            f"{others} others", str(answered - sum(n for _, n in summary.groups.most_common(_MOST_GROUPS))), ""
        )
    problems = _table("problem", "meshes", "for example")
    for name, count in summary.problems.most_common():
        path, detail = summary.examples[name]
        problems.add_row(name, str(count), f"{escape(path)}: {escape(detail)}")
    slowest = _table("slowest", "seconds")
    for milliseconds, path in sorted(summary.slowest, reverse=True):
        slowest.add_row(escape(path), f"{milliseconds / 1e3:.2f}")
    for table in (groups, problems, slowest):
        if table.row_count:
            console.print(table)


def _table(*headings: str) -> Table:
    table = Table(box=None, header_style="dim")
    for heading in headings:
        table.add_column(heading, overflow="fold")
    return table
