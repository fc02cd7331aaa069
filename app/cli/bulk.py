"""``prsnet bulk``: all meshes of a folder, a pattern, tar shards or a bucket, as rows of Parquet files."""

import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from datetime import timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from pydantic import ValidationError
from rich.console import Console
from rich.progress import BarColumn, TextColumn
from rich.progress import Progress as Bar

from app.schemas import LevelName, Mode

if TYPE_CHECKING:
    from app.bulk.job import Progress

_EVERY_S = 10.0


def bulk(
    source: Annotated[
        str, typer.Argument(metavar="INPUT", help="Folder, pattern, file or tar shard; a path or a URI.")
    ],
    target: Annotated[str, typer.Argument(metavar="OUTPUT", help="Folder for the Parquet files; a path or a URI.")],
    address: Annotated[str | None, typer.Option(help="Ray cluster to use ('auto' on one of its machines).")] = None,
    cores: Annotated[int, typer.Option("--cores", "-j", min=0, help="Without --address: cores to use (0: all).")] = 0,
    mode: Annotated[Mode, typer.Option(help="full: refined; paper: the network's own output.")] = "full",
    max_error: Annotated[float, typer.Option(help="Largest symmetry error, unit frame (at most 1).")] = 4e-4,
    level: Annotated[LevelName, typer.Option(help="Which group's elements: see prsnet detect.")] = "auto",
    tolerance: Annotated[
        float | None, typer.Option(help="Instead: the largest group at this RMS, input units.")
    ] = None,
    weights: Annotated[str, typer.Option(help='"default", "paper", or the path of a .safetensors file.')] = "default",
) -> None:
    """Find the symmetries of any number of meshes (needs the extra "bulk"). A second run does what is missing.

    Every mesh gets exactly one row, one that cannot be read a row that says why. PRSNET_* settings bound what a mesh
    may take, as in the service. Exit codes: 0 every mesh has its row, 1 the run failed, 2 wrong usage.
    """
    if not 0 < max_error <= 1:
        raise typer.BadParameter("must be over 0 and at most 1", param_hint="--max-error")
    if tolerance is not None and not 0 < tolerance <= 1e60:
        raise typer.BadParameter("must be more than 0", param_hint="--tolerance")
    try:
        from app.bulk import job
    except ModuleNotFoundError as error:
        raise typer.BadParameter(f'needs the extra "bulk", pip install "prsnet[bulk]": {error}') from error
    from app.bulk.detecting import Task
    from app.bulk.locations import LocationError, Store
    from app.bulk.results import AnotherRunError, Results
    from app.bulk.summary import print_summary, summarise
    from app.settings import UnknownSettingsError, available_cores, settings_of_environment
    from model.errors import CheckpointError
    from model.network.checkpoint import load_checkpoint

    workers = cores or available_cores()
    try:
        store = Store(source)
        inputs = store.list_inputs()
        results = Results(Store(target))
        digest = load_checkpoint(weights).metadata["sha256"]
        question = {"mode": mode, "max_error": max_error, "level": level, "tolerance": tolerance, "weights": digest}
        results.claim(question)
        if weights.endswith(".safetensors"):
            weights = str(Path(weights).absolute())
        settings = settings_of_environment(weights=weights).model_dump(exclude={"api_keys", "workers"})
        if settings["isolation"] == "client":
            settings["isolation"] = "none"  # all files are one client's: no worker need be spared for another's
    except (LocationError, AnotherRunError, CheckpointError, ValidationError, UnknownSettingsError) as error:
        raise typer.BadParameter(str(error)) from error
    console = Console(stderr=True, highlight=False)
    if not console.is_terminal:
        console.width = 120
    done = results.done()
    began = time.perf_counter()
    count = len(job.missing(inputs, done))
    console.print(f"{len(inputs)} inputs, {count} of them without a row")
    if count:
        task = Task(store.location, results.store.location, mode, max_error, level, tolerance, settings)
        try:
            with job.connected(address, workers) as cluster, _shown(console) as show:
                console.print(f"machines: {cluster.nodes}, cores: {cluster.cores}, actors: {cluster.actors}")
                meshes = job.run(task, inputs, cluster, show)
        except OSError as error:  # of which ConnectionError is one
            typer.echo(str(error), err=True)
            raise typer.Exit(1) from error
        spent = time.perf_counter() - began
        console.print(f"{meshes} meshes in {spent:.1f} s, {meshes / spent:.1f}/s")
    summary = summarise(results.rows())
    print_summary(summary, Console(highlight=False) if console.is_terminal else console)
    left = len(job.missing(inputs, results.done()))
    if left:
        typer.echo(f"{left} inputs have no row; run the command again", err=True)
        raise typer.Exit(1)


@contextmanager
def _shown(console: Console) -> Generator[Callable[["Progress"], None], None, None]:
    """Rate and time left: a bar where somebody looks, a line every ten seconds otherwise."""
    began = last = time.perf_counter()

    def text(progress: "Progress") -> str:
        spent = time.perf_counter() - began
        left = spent * (1 / progress.share - 1) if progress.share else 0.0
        return (
            f"{progress.meshes} meshes ({progress.problems} without an answer), {progress.meshes / spent:.1f}/s, "
            f"{progress.share:.0%}, {timedelta(seconds=round(left))} left"
        )

    def line(progress: "Progress") -> None:
        nonlocal last
        if time.perf_counter() - last > _EVERY_S:
            last = time.perf_counter()
            console.print(text(progress))

    if not console.is_terminal:
        yield line
        return
    with Bar(BarColumn(), TextColumn("{task.description}"), console=console, transient=True) as bar:
        task = bar.add_task("starting", total=1.0)
        yield lambda progress: bar.update(task, completed=progress.share, description=text(progress))
