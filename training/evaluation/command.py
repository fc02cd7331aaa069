"""What `training evaluate` does from its arguments to the text it prints."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from training.evaluation.evaluate import Options, evaluate
from training.evaluation.grouping import groups_of, read_column, render_by
from training.evaluation.plain import render_plain
from training.evaluation.report import render, summarise


def run(
    folders: Sequence[Path],
    options: Options,
    *,
    by: str | None = None,
    manifest: Path | None = None,
    json_file: Path | None = None,
    limit: int | None = None,
    ground_truth: Path | None = None,
    workers: int = 1,
    progress: bool = True,
    markdown: bool = False,
) -> str:
    """Judge, write the records, and return the tables.

    Args:
        folders: of meshes.
        options: what is judged.
        by: also one table for each ``source`` (the first folder below the root), or for each value of another column of
            the manifest, such as ``kind``.
        manifest: CSV file with a column ``path`` that holds the names of the shapes.
        json_file: takes options, figures and all records. While the run lasts, FILE.part takes the records; a run
            that was interrupted goes on from there.
        limit: judge so many shapes, drawn at random.
        ground_truth: file of `training groundtruth`.
        workers: processes.
        progress: show a bar.
        markdown: tables as Markdown, one row a method, instead of columns for a terminal.

    Raises:
        ValueError: an argument does not fit.
    """
    written = render if markdown else render_plain
    column = read_column(manifest, by)
    part = None if json_file is None else json_file.with_name(json_file.name + ".part")
    records = evaluate(
        folders,
        options,
        limit=limit,
        ground_truth=ground_truth,
        workers=workers,
        resume=part,
        progress=progress,
    )

    def table(members: Sequence[Mapping[str, Any]]) -> str:
        return written(summarise(members, options.max_error), options.damage, options.max_error)

    report = summarise(records, options.max_error)
    if json_file is not None and part is not None:
        document = {"options": asdict(options), "figures": report, "shapes": records}
        json_file.write_text(json.dumps(document) + "\n", encoding="utf-8")
        part.unlink()
    texts = [written(report, options.damage, options.max_error)]
    if by is not None:
        texts.append(f"## By {by}\n\n{render_by(records, groups_of(records, by, column), table)}")
    return "\n\n".join(texts)
