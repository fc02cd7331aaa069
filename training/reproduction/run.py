"""`training reproduce`: one experiment from meshes to a table, a CSV file and pictures."""

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from training.evaluation import shrec
from training.evaluation.evaluate import Options, evaluate
from training.evaluation.report import ALL_SYMMETRIES, BEST_PLANE, Column, summarise, table
from training.evaluation.resuming import revisions
from training.oracle.truth import load, named
from training.reproduction.contact_sheet import draw_contact_sheet
from training.reproduction.experiment import Experiment, Variant
from training.reproduction.networks import judged_on, train_networks
from training.reproduction.pictures import draw_chart, draw_gallery
from training.shapes.catalogue import write_shapes
from training.trainer.curve import draw_curves

PROCEDURAL = 120
"""Shapes that are made where no folder is given."""

COLUMNS: dict[str, dict[str, Column]] = {
    "meshes": {column[0]: column for column in (*BEST_PLANE, *ALL_SYMMETRIES)},
    "shrec": {column[0]: column for column in shrec.COLUMNS},
}
"""What a table of a protocol can show."""

PICTURES = {"best": "gallery", "planes": "planes", "axes": "axes", "completed": "completed"}
"""Names of the files that `Experiment.pictures` are written to."""


def reproduce(
    name: str,
    folders: Sequence[Path],
    out: Path,
    *,
    judged: Sequence[Path] = (),
    prepared: Path | None = None,
    settings: Sequence[str] = (),
    ground_truth: Path | None = None,
    recorded: Path | None = None,
    limit: int | None = None,
    train_limit: int | None = None,
    steps: int | None = None,
    variants: Sequence[str] = (),
    methods: Sequence[str] = (),
    damages: Sequence[str] = (),
    renew: Sequence[str] = (),
    seed: int = 0,
    workers: int = 1,
    progress: bool = True,
    tell: Callable[[str], None] = lambda line: None,
) -> str:
    """Run an experiment, or go on with one that was interrupted, and write its results.

    Args:
        name: of a file in `experiments`, or a TOML file.
        folders: of meshes; without any, procedural shapes are made in ``out``.
        out: folder of the results: ``results.md``, ``results.csv``, pictures; records and runs to resume from.
        judged: folders of meshes that networks are judged on, where all of ``folders`` go to training.
        prepared: folder of the prepared set instead of one in ``out``: several experiments may share it.
        settings: of the training recipe, for every variant, as `training fit --set` takes them.
        ground_truth: file of `training groundtruth`.
        recorded: planes of other programs, judged beside (`training.evaluation.recorded`).
        limit: judge so many shapes instead of the experiment's number.
        train_limit: train on so many shapes at most.
        steps: of every training instead of the experiment's.
        variants: names of the networks to train; without any all of the experiment.
        methods: instead of the experiment's.
        damages: instead of the experiment's.
        renew: judge these methods anew where what is in ``out`` is of another revision of the code.
        seed: of poses, damage and the draw.
        workers: processes.
        progress: show bars.
        tell: called with a line about every step.

    Returns:
        the text of ``results.md``.

    Raises:
        ValueError: an argument does not fit.
    """
    experiment = Experiment.load(name)
    if methods:
        experiment = replace(experiment, methods=tuple(methods))
    if damages:
        experiment = replace(experiment, damages=tuple(damages))
    if variants:
        experiment = replace(experiment, variants=_chosen(experiment, variants))
    experiment = replace(experiment, limit=limit or experiment.limit)
    out.mkdir(parents=True, exist_ok=True)
    if experiment.protocol == "shrec":
        return _reproduce_clouds(experiment, out, renew, seed, workers, progress, tell)
    if not folders:
        folders = [out / "shapes"]
        if not (folders[0] / "ground_truth.json").is_file():
            write_shapes(folders[0], PROCEDURAL, seed)
    if not experiment.variants and (judged or prepared or settings or steps or train_limit):
        raise ValueError(f"{name} trains nothing: --judge, --prepared, --set, --steps and --train-limit are of no use")
    names = dict.fromkeys(experiment.methods)
    only: Callable[[str], bool] | None = None
    titles: dict[str, str] = {}
    if experiment.variants:
        trained = train_networks(
            experiment,
            folders,
            out,
            train_share=1.0 if judged else experiment.train_share,
            prepared=prepared,
            settings=settings,
            steps=steps,
            limit=train_limit,
            workers=workers,
            progress=progress,
            tell=tell,
        )
        for variant, weights in trained.values():
            for method in variant.methods:
                full_name = method.replace("WEIGHTS", str(weights))
                names[full_name] = None
                titles[full_name] = f"{variant.name}: {method.partition(':')[0]}"
        draw_curves([out / "runs" / variant for variant in trained], out / "curves.png")
        if judged:
            folders = judged
        else:
            only = partial(judged_on, train_share=experiment.train_share)

    sections: list[str] = []
    rows: list[dict[str, Any]] = []
    charts: dict[str, Mapping[str, Mapping[str, Any]]] = {}
    for damage in experiment.damages:
        tell(f"{name}: {damage}")
        options = Options(
            damage, tuple(names), experiment.max_error, seed, experiment.symmetric, experiment.words,
            "" if recorded is None or damage not in ("clean", "rotated") else str(recorded),
        )  # fmt: skip
        records = evaluate(
            folders,
            options,
            limit=experiment.limit,
            ground_truth=ground_truth,
            workers=workers,
            resume=out / f"records-{damage}.jsonl",
            renew=renew,
            progress=progress,
            only=only,
        )
        report = summarise(records, experiment.max_error)
        figures = {key: of | {"title": titles.get(key, of["title"])} for key, of in report["methods"].items()}
        charts[damage] = figures
        sections.append(f"{_section(experiment, damage, report, figures)}\n\n{_judged_at(records)}")
        rows += [{"damage": damage, "method": key, **_plain(of)} for key, of in figures.items()]
        if experiment.gallery:
            drawn = [record for record in records if "skipped" not in record][: experiment.gallery]
            pictures = {kind: out / f"{PICTURES[kind]}-{damage}.png" for kind in experiment.pictures}
            draw_gallery(folders, drawn, figures, pictures, damage=damage, seed=seed, max_error=experiment.max_error)
        if experiment.sheet and not (out / "truth.png").is_file():
            shown = [record["name"] for record in records if "skipped" not in record]
            known = {} if ground_truth is None else named(load(ground_truth), shown)
            draw_contact_sheet(folders, shown, known, out / "truth.png")
    return _written(experiment, out, charts, rows, sections, ", ".join(folder.name for folder in folders))


def _chosen(experiment: Experiment, names: Sequence[str]) -> tuple[Variant, ...]:
    known = {variant.name: variant for variant in experiment.variants}
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ValueError(f"it trains no {', '.join(unknown)}; its networks are {', '.join(known) or 'none'}")
    return tuple(known[name] for name in names)


def _reproduce_clouds(
    experiment: Experiment,
    out: Path,
    renew: Sequence[str],
    seed: int,
    workers: int,
    progress: bool,
    tell: Callable[[str], None],
) -> str:
    sections: list[str] = []
    rows: list[dict[str, Any]] = []
    charts: dict[str, Mapping[str, Mapping[str, Any]]] = {}
    for damage in experiment.damages:
        tell(f"shrec: {damage}")
        options = shrec.Options(damage, experiment.methods, experiment.max_error, seed)
        part = out / f"records-{damage}.jsonl"
        records = shrec.evaluate_clouds(
            options, limit=experiment.limit, workers=workers, resume=part, renew=renew, progress=progress
        )
        charts[damage] = figures = shrec.summarise_clouds(records)
        sections.append(
            f"{shrec.heading(records, damage)}\n\n{table(figures, _columns(experiment))}\n\n{_judged_at(records)}"
        )
        rows += [{"damage": damage, "method": key, **_plain(of)} for key, of in figures.items()]
    return _written(experiment, out, charts, rows, sections, "point clouds of extruded plane curves")


def _written(
    experiment: Experiment,
    out: Path,
    charts: Mapping[str, Mapping[str, Mapping[str, Any]]],
    rows: Sequence[Mapping[str, Any]],
    sections: Sequence[str],
    shapes: str,
) -> str:
    """Write chart, CSV file and page; the text of the page."""
    draw_chart(charts, COLUMNS[experiment.protocol][experiment.chart], out / "chart.png")
    _write_csv(out / "results.csv", rows)
    text = _page(experiment, shapes, sections)
    (out / "results.md").write_text(text + "\n", encoding="utf-8")
    return text


def _columns(experiment: Experiment) -> list[Column]:
    known = COLUMNS[experiment.protocol]
    return [known[key] for key in experiment.columns] or list(known.values())


def _section(
    experiment: Experiment, damage: str, report: Mapping[str, Any], figures: Mapping[str, Mapping[str, Any]]
) -> str:
    return (
        f"{damage}: {report['shapes']} shapes, {report['clear']} of them with a clear plane, "
        f"{report['clear_planes']} clear planes; t = {experiment.max_error:g}\n\n{table(figures, _columns(experiment))}"
    )


def _judged_at(records: Sequence[Mapping[str, Any]]) -> str:
    """At which revision of the code, and of what not all methods have in common also which of them."""
    by = {f"{revision[:7]}{revision[40:]}": titles for revision, titles in revisions(records).items()}
    if len(by) == 1:
        return f"Judged at revision {next(iter(by))}."
    return (
        "Judged at revision " + "; ".join(f"{revision}: {', '.join(titles)}" for revision, titles in by.items()) + "."
    )


def _page(experiment: Experiment, shapes: str, sections: Sequence[str]) -> str:
    head = [
        f"# {experiment.title}",
        f"The paper, on its own shapes: {experiment.claim}",
        f"Differences: {experiment.differences}",
        f"What it takes: {experiment.minimum}",
        f"Shapes: {shapes}",
    ]
    return "\n\n".join([*head, *sections])


def _plain(figures: Mapping[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in figures.items() if not isinstance(value, dict)}


def _write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    columns = dict.fromkeys(key for row in rows for key in row)
    with path.open("w", newline="", encoding="utf-8") as lines:
        writer = csv.DictWriter(lines, list(columns))
        writer.writeheader()
        writer.writerows(
            {key: json.dumps(value) if isinstance(value, list) else value for key, value in row.items()} for row in rows
        )
