"""Commands that judge: `python -m training evaluate | imperfect | calibrate | reproduce | groundtruth`.

Imports stand inside the commands: `fit` must start on a machine that has no mesh library.
"""

from pathlib import Path
from typing import Annotated

import typer

Verbose = Annotated[bool, typer.Option("--progress/--no-progress", help="Show a progress bar.")]


def evaluate(
    folders: Annotated[
        list[Path] | None, typer.Argument(help="Folders of meshes; a ground_truth.json beside them is used.")
    ] = None,
    protocol: Annotated[
        str, typer.Option(help="meshes, or shrec: point clouds made here, counted as the SHREC 2023 track does.")
    ] = "meshes",
    methods: Annotated[
        str | None,
        typer.Option(
            help="What to set side by side, separated by commas: full, paper, raw (with :WEIGHTS), a classical method, "
            "exhaustive; +refined or +validated behind one; ablation. What else there is an unknown name tells."
        ),
    ] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="Judge this many shapes, drawn at random.")] = None,
    damage: Annotated[
        str | None,
        typer.Option(
            help="clean: pose as in the file; in random poses: rotated (the default), noisy, partial (a ball missing), "
            "ball25, ball35, depth1 and depth3 (what so many depth images see), decimated. Of clouds, separated by "
            "commas: clean, uniform, gaussian, undersampled, hard, severe; all by default."
        ),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of poses, damage and the draw of shapes.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    json_file: Annotated[Path | None, typer.Option("--json", help="Also write figures and records here.")] = None,
    ground_truth: Annotated[
        Path | None,
        typer.Option(
            "--groundtruth", help="File that `groundtruth` wrote; what it lacks is searched for, seconds a shape."
        ),
    ] = None,
    max_error: Annotated[float, typer.Option(help="Threshold on the symmetry error (SDE).")] = 4e-4,
    symmetric: Annotated[bool, typer.Option(help="Only shapes with a clear plane.")] = False,
    recorded: Annotated[
        Path | None,
        typer.Option(help="CSV file of planes that other programs found: judged beside, on the meshes it names."),
    ] = None,
    by: Annotated[
        str | None,
        typer.Option(help="Also tables by source, by unseen sources, or by a column of the manifest, such as kind."),
    ] = None,
    manifest: Annotated[Path | None, typer.Option(help="CSV file with a column path, for --by.")] = None,
    markdown: Annotated[bool, typer.Option("--markdown", help="Tables as Markdown, one row a method.")] = False,
    progress: Verbose = True,
) -> None:
    """Judge networks, the detector's modes and classical methods side by side: exact distances, one report."""
    from training.evaluation import command, shrec
    from training.evaluation.evaluate import Options
    from training.evaluation.registry import DEFAULT_METHODS
    from training.shapes.clouds import PERTURBATIONS

    try:
        names = DEFAULT_METHODS if methods is None else tuple(methods.split(","))
        if protocol not in ("meshes", "shrec"):
            raise ValueError(f"protocol is meshes or shrec, not {protocol!r}")
        if (protocol == "meshes") != bool(folders):
            raise ValueError("meshes come from folders, clouds are made: the protocol shrec takes no folder")
        if protocol == "shrec":
            text = shrec.run(
                damage.split(",") if damage else tuple(PERTURBATIONS),
                names,
                max_error=max_error,
                seed=seed,
                limit=limit or shrec.CLOUDS,
                workers=workers,
                json_file=json_file,
                progress=progress,
            )
            typer.echo(text)
            return
        text = command.run(
            folders or [],
            Options(damage or "rotated", names, max_error, seed, symmetric, recorded=str(recorded or "")),
            by=by,
            manifest=manifest,
            json_file=json_file,
            limit=limit,
            ground_truth=ground_truth,
            workers=workers,
            progress=progress,
            markdown=markdown,
        )
    except (ValueError, OSError) as error:
        raise typer.BadParameter(str(error)) from error
    typer.echo(text)


def reproduce(
    experiment: Annotated[
        str, typer.Argument(help="A table or figure of the paper, as `list` lists them, or a TOML file.")
    ],
    folders: Annotated[
        list[Path] | None, typer.Argument(help="Folders of meshes; without any, procedural shapes are made.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Folder of results; reproduced/EXPERIMENT.")] = None,
    judged: Annotated[
        list[Path] | None,
        typer.Option("--judge", help="Judge networks on this folder, and train on all of the others; may be repeated."),
    ] = None,
    prepared: Annotated[
        Path | None, typer.Option(help="Folder of the prepared set, for several experiments that share one.")
    ] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="SECTION.FIELD=VALUE of the training recipe; may be repeated.")
    ] = None,
    ground_truth: Annotated[Path | None, typer.Option("--groundtruth", help="File that `groundtruth` wrote.")] = None,
    recorded: Annotated[Path | None, typer.Option(help="CSV file of planes that other programs found.")] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="Judge so many shapes instead of its own number.")] = None,
    train_limit: Annotated[int | None, typer.Option(min=8, help="Train on so many shapes at most.")] = None,
    steps: Annotated[int | None, typer.Option(min=1, help="Train this long instead of its own steps.")] = None,
    variants: Annotated[str | None, typer.Option(help="Train these networks of it alone, separated by commas.")] = None,
    methods: Annotated[str | None, typer.Option(help="Instead of its own, separated by commas.")] = None,
    damage: Annotated[str | None, typer.Option(help="Instead of its own, separated by commas.")] = None,
    renew: Annotated[
        str | None,
        typer.Option(help="Judge these methods anew where the results at hand are of another revision of the code."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Seed of poses, damage and the draw of shapes.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    progress: Verbose = True,
) -> None:
    """Reproduce a table of the paper on meshes at hand, every rival beside. Call it again to resume."""
    from training.reproduction.experiment import Experiment, known_experiments
    from training.reproduction.run import reproduce as run

    if experiment == "list":
        for name in known_experiments():
            typer.echo(f"{name:20s} {Experiment.load(name).title}")
        return
    try:
        text = run(
            experiment,
            folders or [],
            out or Path("reproduced") / Path(experiment).stem,
            judged=judged or (),
            prepared=prepared,
            settings=settings or (),
            ground_truth=ground_truth,
            recorded=recorded,
            limit=limit,
            train_limit=train_limit,
            steps=steps,
            variants=variants.split(",") if variants else (),
            methods=methods.split(",") if methods else (),
            damages=damage.split(",") if damage else (),
            renew=renew.split(",") if renew else (),
            seed=seed,
            workers=workers,
            progress=progress,
            tell=lambda line: typer.echo(line, err=True),
        )
    except (ValueError, OSError) as error:
        raise typer.BadParameter(str(error)) from error
    typer.echo(text)


def groundtruth(
    folders: Annotated[list[Path], typer.Argument(help="Folders of meshes.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="JSON file to write, all in each shape's unit frame.")],
    limit: Annotated[int | None, typer.Option(min=1, help="Search the first of them only.")] = None,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    progress: Verbose = True,
) -> None:
    """Search every plane and axis of every mesh: exhaustive, slow, independent of the detector. Resumes."""
    from training.oracle.groundtruth import groundtruth as run

    try:
        summary = run(folders, out, limit=limit, workers=workers, progress=progress)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    typer.echo(f"{summary.shapes} shapes in {out}, {summary.searched} searched now, {summary.skipped} skipped")


def imperfect(
    names: Annotated[list[str] | None, typer.Argument(help="Kinds of imperfection, or families; all of them.")] = None,
    shapes: Annotated[int, typer.Option(min=1, help="Shapes of each family.")] = 1,
    seed: Annotated[int, typer.Option(help="Seed of the shapes and of what is done to them.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    progress: Verbose = True,
) -> None:
    """Whether the point group of shapes of known group is told, however imperfect they are."""
    from training.evaluation.imperfect import render, run

    try:
        results = run(names or (), shapes=shapes, seed=seed, workers=workers, progress=progress)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    typer.echo(render(results))


def calibrate(
    folders: Annotated[list[Path], typer.Argument(help="Folders of meshes of the training split.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="JSON file to write; model/search/confidence.json is used.")],
    limit: Annotated[int, typer.Option(min=1, help="So many of them, drawn at random.")] = 300,
    procedural: Annotated[int, typer.Option(min=0, help="So many procedural shapes besides.")] = 100,
    seed: Annotated[int, typer.Option(help="Seed of all that is drawn.")] = 0,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    progress: Verbose = True,
) -> None:
    """Learn the confidence of an answer from shapes damaged on purpose, and check it on others."""
    from training.evaluation.calibration import render, run

    try:
        record = run(folders, out, limit=limit, procedural=procedural, seed=seed, workers=workers, progress=progress)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    typer.echo(render(record))
