"""Command line: `python -m training prepare | label | fit | export | heldout | shapes | curve`, and `judging_commands`.

Imports stand inside the commands: `fit` must start on a machine that has no mesh library.
"""

import os
import shlex
from pathlib import Path
from typing import Annotated, Any

import typer

from training import judging_commands
from training.judging_commands import Verbose

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,  # it would take what stands in brackets for its own
    help="Train PRS-Net on your own meshes and judge the result.",
)


@app.command()
def prepare(
    folders: Annotated[
        list[Path],
        typer.Argument(
            help="Folders of meshes, plain or as ShapeNetCore.v2, ModelNet, ABC and Thingi10K are published."
        ),
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="Where the prepared set goes.")],
    samples: Annotated[int, typer.Option(min=1000, help="Surface samples stored a shape.")] = 4096,
    resolution: Annotated[int, typer.Option(help="Edge of the voxel and closest-point grids.")] = 32,
    mesh_only: Annotated[
        bool, typer.Option(help="Leave out what `fit` can derive: a tenth of the size, to travel to another machine.")
    ] = False,
    split: Annotated[
        str | None, typer.Option(help="Take only this part, where the data has an official one: train, val or test.")
    ] = None,
    manifest: Annotated[
        Path | None, typer.Option(help="CSV file: path, and any of source, category, licence, split.")
    ] = None,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    progress: Verbose = True,
) -> None:
    """Turn folders of meshes into packed arrays. Call it again to resume."""
    from training.data.prepare import Options
    from training.data.prepare import prepare as run

    try:
        options = Options(resolution, samples, mesh_only)
        summary = run(folders, out, options, workers, progress, split=split, manifest=manifest)
    except (ValueError, OSError) as error:
        raise typer.BadParameter(str(error)) from error
    typer.echo(f"{summary.shapes} shapes prepared, {summary.skipped} skipped ({out / 'skipped.csv'})")
    typer.echo(f"data manifest {summary.sha256}")


@app.command()
def label(
    prepared: Annotated[Path, typer.Argument(help="A prepared set; the labels are written into it.")],
    method: Annotated[
        str,
        typer.Option(
            help="scan: full mode without a network; pca, kazhdan, ...: refined planes of a classical method; "
            "groundtruth: from a file."
        ),
    ] = "scan",
    truth: Annotated[
        Path | None, typer.Option("--groundtruth", help="The file that `groundtruth` wrote of the same folders.")
    ] = None,
    planes: Annotated[int, typer.Option(min=1, help="At most so many planes a shape, the best.")] = 16,
    max_error: Annotated[float, typer.Option(help="Largest symmetry error (SDE) of a label.")] = 4e-4,
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    progress: Verbose = True,
) -> None:
    """Find planes with a classical method, for the recipe's section [supervision]. Call it again to resume."""
    from training.data.labels import Options
    from training.data.labels import label as run
    from training.data.prepared import PreparedSet

    try:
        summary = run(PreparedSet(prepared), Options(method, planes, max_error), truth, workers, progress)
    except (ValueError, OSError) as error:
        raise typer.BadParameter(str(error)) from error
    typer.echo(
        f"{summary.labelled} of {summary.shapes} shapes labelled: {summary.planes} planes, "
        f"{summary.axes} continuous axes"
    )


@app.command()
def views(
    prepared: Annotated[Path, typer.Argument(help="Folder that `prepare` wrote.")],
    workers: Annotated[int, typer.Option(min=1, help="Processes.")] = 1,
    progress: Verbose = True,
) -> None:
    """Render what depth images from random sides see, for the recipe's damage.scans. Call it again to resume."""
    from training.data.prepared import PreparedSet
    from training.data.views import render_views

    try:
        summary = render_views(PreparedSet(prepared), workers, progress)
    except (ValueError, OSError) as error:
        raise typer.BadParameter(str(error)) from error
    typer.echo(f"{summary.shapes} shapes in {summary.pieces} pieces")


@app.command()
def fit(
    prepared: Annotated[Path, typer.Argument(help="A prepared set.")],
    run: Annotated[Path, typer.Option("--run", "-r", help="Folder of the run; an interrupted run is resumed.")],
    recipe: Annotated[str, typer.Option(help="A shipped recipe (default, paper) or a TOML file.")] = "default",
    mix: Annotated[
        list[str] | None,
        typer.Option(help="PREPARED:SHARE: so much of what is drawn comes from another set; may be repeated."),
    ] = None,
    device: Annotated[str | None, typer.Option(help="cuda, cpu, ...; a GPU if there is one.")] = None,
    steps: Annotated[
        int | None,
        typer.Option(min=1, help="Train this long instead of the recipe's steps; a larger number extends a run."),
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Instead of the recipe's seed.")] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="SECTION.FIELD=VALUE instead of the recipe's; may be repeated.")
    ] = None,
    start: Annotated[
        str | None, typer.Option(help="Weights to begin with, as in `default` or a .safetensors file, not random ones.")
    ] = None,
    threads: Annotated[int, typer.Option(min=1, help="CPU threads of torch.")] = 1,
    amp: Annotated[
        str | None, typer.Option(help="bf16: convolutions in bfloat16, for GPUs; the loss stays in float32.")
    ] = None,
    validate_every: Annotated[
        int, typer.Option(min=1, help="Steps between validations, and between checkpoints to go on from.")
    ] = 1000,
    max_minutes: Annotated[float | None, typer.Option(help="Stop after this long, to be resumed.")] = None,
    tensorboard: Annotated[bool, typer.Option(help="Write TensorBoard curves beside the CSV.")] = True,
    progress: Verbose = True,
) -> None:
    """Train a network. Needs torch and numpy alone, beside this command line.

    Several processes, one for each GPU: `torchrun --nproc-per-node 4 -m training fit ...`. The recipe's batch is
    divided among them, and the result is that of one process.
    """
    import torch

    from model.errors import PRSNetError
    from training.data.mixture import Mixture
    from training.data.prepared import PreparedSet
    from training.recipe import Recipe
    from training.trainer.fit import Initialization
    from training.trainer.fit import fit as train
    from training.trainer.monitor import CollapseError

    torch.set_num_threads(threads)
    if amp not in (None, "bf16"):
        raise typer.BadParameter(f"--amp is bf16 or left out, not {amp!r}")
    main = os.environ.get("RANK", "0") == "0"
    try:
        chosen = Recipe.load(recipe).with_settings(settings or [])
        if steps is not None:
            chosen = chosen.replace(optimizer={"steps": steps})
        if seed is not None:
            chosen = chosen.replace(seed=seed)
        data = PreparedSet(prepared)
        if mix:
            data = Mixture(data, [_share(entry) for entry in mix])
        begin = None
        if start is not None:
            from model.network.checkpoint import load_checkpoint

            given = load_checkpoint(start)
            begin = Initialization(given.network, {key: given.metadata[key] for key in ("name", "version", "sha256")})
    except (ValueError, PRSNetError) as error:
        raise typer.BadParameter(str(error)) from error
    bar, on_progress, on_derive = _bars(chosen.optimizer.steps, progress and main)
    try:
        best = train(
            chosen,
            data,
            run,
            start=begin,
            device=device,
            precision="float32" if amp is None else "bf16",
            validate_every=validate_every,
            max_seconds=None if max_minutes is None else 60.0 * max_minutes,
            on_progress=on_progress,
            on_derive=on_derive,
            on_message=lambda message: typer.echo(message, err=True),
            writer=_tensorboard(run) if tensorboard and main else None,
        )
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    except (CollapseError, FloatingPointError) as error:
        typer.echo(f"The run was ended: {error}", err=True)
        raise typer.Exit(1) from error
    finally:
        if bar is not None:
            bar.close()
    if main:
        weights = run / f"{chosen.name}.safetensors"
        typer.echo(f"best checkpoint {best}; make weights of it that the service loads:")
        typer.echo(f"  {shlex.join(['python', '-m', 'training', 'export', str(run), '-o', str(weights)])}")


@app.command()
def export(
    run: Annotated[Path, typer.Argument(help="Folder of a run.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The .safetensors file to write; its .json goes beside it.")],
    name: Annotated[str | None, typer.Option(help="Name of the weights; the recipe's by default.")] = None,
    metrics: Annotated[
        list[Path] | None, typer.Option(help="JSON files written by `evaluate --json`, kept in the metadata.")
    ] = None,
    checkpoint: Annotated[str, typer.Option(help="best or last")] = "best",
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="passes=N, sign_frames=N or views=N instead of the recipe's.")
    ] = None,
) -> None:
    """Turn a training checkpoint into weights the service loads."""
    from training.trainer.export import export_run

    try:
        export_run(run, out, name=name, metrics=metrics or [], which=checkpoint, settings=settings or [])
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    typer.echo(f"wrote {out} and {out.with_suffix('.json')}")


for command in (
    judging_commands.evaluate,
    judging_commands.imperfect,
    judging_commands.calibrate,
    judging_commands.reproduce,
    judging_commands.groundtruth,
):
    app.command()(command)


@app.command()
def heldout(
    prepared: Annotated[Path, typer.Argument(help="Folder that `prepare` wrote and `label` labelled.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the meshes and their truth.json.")],
    share: Annotated[float, typer.Option(min=0.0, max=1.0, help="The recipe's validation_share.")] = 0.05,
    limit: Annotated[int | None, typer.Option(min=1, help="Write so many of them, drawn at random.")] = None,
) -> None:
    """Write the shapes `fit` keeps for validation as meshes: settings are chosen on them, with `evaluate`."""
    from training.data.heldout import TRUTH_FILE, write_held_out
    from training.data.prepared import PreparedSet

    try:
        count = write_held_out(PreparedSet(prepared), out, share, limit)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    typer.echo(f"{count} shapes in {out}; judge with `training evaluate {out} --groundtruth {out / TRUTH_FILE}`")


@app.command()
def shapes(
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for the PLY files and ground_truth.json.")],
    count: Annotated[int, typer.Option(min=1)] = 100,
    seed: Annotated[int, typer.Option()] = 0,
) -> None:
    """Write procedural shapes with known symmetries: to train, test and demonstrate without any data at hand."""
    from training.shapes.catalogue import write_shapes

    write_shapes(out, count, seed)
    typer.echo(f"wrote {count} shapes to {out}")


@app.command()
def curve(
    runs: Annotated[list[Path], typer.Argument(help="Folders of runs.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="PNG or SVG to write.")],
) -> None:
    """Draw the training curves of runs."""
    from training.trainer.curve import draw_curves

    draw_curves(runs, out)
    typer.echo(f"wrote {out}")


def _share(entry: str) -> Any:
    """PREPARED:SHARE as a prepared set and a number."""
    from training.data.prepared import PreparedSet

    path, _, share = entry.rpartition(":")
    try:
        return PreparedSet(path), float(share)
    except ValueError as error:
        raise ValueError(f"--mix takes PREPARED:SHARE, not {entry!r} ({error})") from error


def _bars(steps: int, shown: bool) -> tuple[Any, Any, Any]:
    """A progress bar where tqdm is installed (it is not on a bare GPU machine), plain lines elsewhere."""
    if not shown:
        return None, None, None
    try:
        from tqdm import tqdm
    except ImportError:

        def line(progress: Any) -> None:
            typer.echo(
                f"step {progress.step}/{progress.steps}  loss {progress.loss:.4f}  "
                f"{progress.samples_per_second:.0f} samples/s  {progress.seconds_left / 60:.1f} min left"
            )

        return None, line, None
    bar = tqdm(total=steps, unit="step")

    def update(progress: Any) -> None:
        bar.update(progress.step - bar.n)
        bar.set_postfix(loss=f"{progress.loss:.3f}", samples_per_second=f"{progress.samples_per_second:.0f}")

    def derive(done: int, total: int) -> None:
        bar.set_description(f"closest-point grids {done}/{total}" if done < total else "")

    return bar, update, derive


def _tensorboard(run: Path) -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        typer.echo("TensorBoard is not installed; the curve goes to curve.csv alone.", err=True)
        return None
    return SummaryWriter(str(run / "tensorboard"))


if __name__ == "__main__":
    app()
