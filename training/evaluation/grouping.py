"""Which group of shapes a record of an evaluation belongs to: its source, or what a manifest says of it."""

import csv
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

SOURCE = "source"
UNSEEN = "unseen"
"""Whether training saw other meshes of a shape's source."""


def read_column(manifest: Path | None, by: str | None) -> dict[str, str]:
    """The column ``by`` of a manifest by the names of the shapes (its column ``path``); empty for `SOURCE` and None.

    `UNSEEN` is made of the columns ``source`` and ``split``.

    Raises:
        ValueError: there is no manifest, or it lacks a column.
    """
    if by is None or by == SOURCE:
        return {}
    if manifest is None:
        raise ValueError(f"tables by {by} need --manifest, a CSV file with the columns path and {by}")
    with manifest.open(newline="", encoding="utf-8") as lines:
        rows = list(csv.DictReader(lines))
    wanted = ("path", "source", "split") if by == UNSEEN else ("path", by)
    if not rows or not set(wanted) <= set(rows[0]):
        raise ValueError(f"{manifest} lacks one of the columns {', '.join(wanted)}")
    if by == UNSEEN:
        seen = {row["source"] for row in rows if row["split"] == "train"}
        return {row["path"]: "sources seen" if row["source"] in seen else "sources never seen" for row in rows}
    return {row["path"]: row[by] for row in rows}


def groups_of(records: Sequence[Mapping[str, Any]], by: str, column: Mapping[str, str]) -> dict[str, str]:
    """The group of every record by its name."""
    if by == SOURCE:
        return {record["name"]: str(record["source"]) for record in records}
    return {record["name"]: column.get(record["name"], "(not in the manifest)") for record in records}


def render_by(
    records: Sequence[Mapping[str, Any]],
    groups: Mapping[str, str],
    table: Callable[[Sequence[Mapping[str, Any]]], str],
) -> str:
    """One table for each group of shapes; ``groups`` names the group of every record by its name."""
    texts: list[str] = []
    for group in sorted(set(groups.values())):
        members = [record for record in records if groups.get(record["name"]) == group]
        if any("skipped" not in record for record in members):
            texts.append(f"### {group}\n\n{table(members)}")
    return "\n\n".join(texts)
