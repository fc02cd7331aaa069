"""What `training evaluate --mode full` does from its arguments to the text it prints."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from training.evaluation.full_evaluation import Options, evaluate
from training.evaluation.full_methods import ablation
from training.evaluation.full_report import render, summarise
from training.evaluation.grouping import groups_of, read_column, render_by


def run(
    folders: Sequence[Path],
    options: Options,
    *,
    with_ablation: bool = False,
    by: str | None = None,
    manifest: Path | None = None,
    json_file: Path | None = None,
    limit: int | None = None,
    ground_truth: Path | None = None,
    workers: int = 1,
    progress: bool = True,
) -> str:
    """Judge, write the records, and return the tables.

    Args:
        folders: of meshes.
        options: what is judged.
        with_ablation: judge full mode with several sets of proposal sources too, in a table of their own.
        by: also one table for each ``source`` (the first folder below the root), or for each value of another column of
            the manifest, such as ``kind``.
        manifest: CSV file with a column ``path`` that holds the names of the shapes.
        json_file: takes options, figures and all records. While the run lasts, FILE.part takes the records; a run
            that was interrupted goes on from there.
        limit: judge so many shapes, drawn at random.
        ground_truth: file of `training groundtruth`.
        workers: processes.
        progress: show a bar.

    Raises:
        ValueError: an argument does not fit.
    """
    if with_ablation:
        options = replace(options, methods=tuple(dict.fromkeys((*options.methods, *ablation()))))
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
        return render(summarise(members, options.max_error), options.damage)

    report = summarise(records, options.max_error)
    if json_file is not None and part is not None:
        document = {"options": asdict(options), "figures": report, "shapes": records}
        json_file.write_text(json.dumps(document) + "\n", encoding="utf-8")
        part.unlink()
    texts = [render(report, options.damage)]
    if with_ablation:
        texts.append(f"## Sources of proposals\n\n{render(report, options.damage, ablation=True)}")
    if by is not None:
        texts.append(f"## By {by}\n\n{render_by(records, groups_of(records, by, column), table)}")
    return "\n\n".join(texts)
