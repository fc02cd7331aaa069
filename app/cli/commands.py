"""The command line: what ``prsnet`` does.

Exit codes: 0 all went well; 1 some files failed, or the server could not start; 2 wrong usage; 3 no file had an answer;
4 the service of ``--url`` is not there; 130 interrupted.
"""

import atexit
import gc
import time
from pathlib import Path
from typing import Annotated, Any

import typer

from app import __version__
from app.cli import editing
from app.cli.batch import Outcome, Task
from app.cli.bulk import bulk
from app.cli.options import ApiKey, Exit, MaxError, Overwrite, Url, Weights, load, require_max_error
from app.cli.twins import twins
from app.schemas import Include, LevelName, Mode

app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,  # it would take what stands in brackets for its own
    pretty_exceptions_enable=False,
    epilog="Exit codes: 0 all went well, 1 some files failed, 2 wrong usage, 3 all files failed, "
    "4 the service of --url is not there.",
)


_OBJECTS_BETWEEN_COLLECTIONS = 50_000


def main() -> None:
    """The program ``prsnet``: `app`, quick to begin and to end.

    What is imported makes some hundred thousand objects that live until the end. Looking for cycles among them while
    they are made, and once more before the process ends, would take a third of the time of a short command.
    """
    gc.set_threshold(_OBJECTS_BETWEEN_COLLECTIONS)
    atexit.register(gc.freeze)
    app()


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"prsnet {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Find the mirror planes and rotation axes of 3D meshes."""


app.command()(bulk)


@app.command()
def serve(
    host: Annotated[str | None, typer.Option(help="Address to listen on.")] = None,
    port: Annotated[int | None, typer.Option(help="Port to listen on; 0 picks a free one.")] = None,
    workers: Annotated[int | None, typer.Option(help="Meshes worked on at a time (default: one a core).")] = None,
    weights: Annotated[str | None, typer.Option(help='"default", "paper", or a .safetensors file.')] = None,
    log_level: Annotated[str | None, typer.Option(help="debug, info, warning or error.")] = None,
) -> None:
    """Serve the HTTP API. What is not given here comes from PRSNET_* environment variables."""
    from pydantic import ValidationError

    from app.http import server
    from app.http.tracing import TracingNotInstalledError
    from app.settings import UnknownSettingsError, settings_of_environment

    given: dict[str, Any] = {
        "host": host, "port": port, "workers": workers, "weights": weights, "log_level": log_level
    }  # fmt: skip
    try:
        settings = settings_of_environment(**{name: value for name, value in given.items() if value is not None})
    except UnknownSettingsError as error:
        raise typer.BadParameter(str(error)) from error
    except ValidationError as error:
        # Environment variables may be at fault as well as options, so both names are given.
        faults = [f"{item['loc'][0]} (PRSNET_{str(item['loc'][0]).upper()}): {item['msg']}" for item in error.errors()]
        raise typer.BadParameter("; ".join(faults)) from error
    try:
        raise typer.Exit(server.serve(settings))
    except TracingNotInstalledError as error:
        raise typer.BadParameter(str(error)) from error


@app.command()
def detect(
    files: Annotated[
        list[str],
        typer.Argument(metavar="FILE", help="Mesh files, folders of them, patterns, - for standard input."),
    ],
    as_json: Annotated[bool, typer.Option("--json", help="JSON as POST /detect answers; a list if several.")] = False,
    as_lines: Annotated[bool, typer.Option("--jsonl", help="JSON, one line a file, as soon as it is there.")] = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="A row a plane or axis.")] = False,
    as_bop: Annotated[bool, typer.Option("--bop", help="A models_info.json for a BOP data set.")] = False,
    format: Annotated[str | None, typer.Option(help="Print in a format; a wrong name lists them.")] = None,
    glb: Annotated[bool, typer.Option("--glb", help="Also write NAME-symmetries.glb with planes and axes.")] = False,
    png: Annotated[bool, typer.Option("--png", help="Also write a picture NAME-symmetries.png.")] = False,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder for these files; without them, file for the result itself."),
    ] = None,
    overwrite: Overwrite = False,
    up: Annotated[str | None, typer.Option(help="Which axis points up in pictures: y or z.")] = None,
    mode: Annotated[Mode, typer.Option(help="full: refined; paper: the network's own output.")] = "full",
    max_error: MaxError = 4e-4,
    level: Annotated[
        LevelName, typer.Option(help="auto: with the most room above it; exact: up to the file.")
    ] = "auto",
    tolerance: Annotated[
        float | None, typer.Option(help="Instead: the largest group within this RMS deviation, in the file's unit.")
    ] = None,
    rejected: Annotated[bool, typer.Option("--rejected", help="In JSON, also rejected candidates and why.")] = False,
    jobs: Annotated[int, typer.Option("--jobs", "-j", min=0, help="Files at a time (0: one a core).")] = 0,
    weights: Weights = "default",
    url: Url = None,
    api_key: ApiKey = None,
) -> None:
    """Find the symmetries of mesh files. Results go to standard output or -o, what failed is listed on standard error.

    Files of the same name in different folders keep their folders in the names of what is written.

    Exit codes: 0 all went well, 1 some files failed, 2 wrong usage, 3 all failed, 4 the service is not there.
    """
    from app.cli import batch, inputs
    from app.cli.listing import LINES, TABLE, Listing, format_of
    from app.outputs.output_format import Options
    from app.settings import available_cores

    require_max_error(max_error)
    if tolerance is not None and not 0 < tolerance <= 1e60:
        raise typer.BadParameter("must be more than 0", param_hint="--tolerance")
    shorthands = {"json": as_json, LINES: as_lines, "csv": as_csv, "bop": as_bop}
    formats = [name for name, asked in shorthands.items() if asked] + ([format] if format else [])
    if len(formats) > 1:
        raise typer.BadParameter("at most one of --format, --json, --jsonl, --csv and --bop")
    if up not in (None, "y", "z"):
        raise typer.BadParameter("must be y or z", param_hint="--up")
    format = formats[0] if formats else TABLE
    file, folder = None, Path()
    if glb or png:
        folder = output or Path()
    elif output is not None:
        file = output
        format = format if formats else format_of(file)
        if format == TABLE or file.is_dir():
            raise typer.BadParameter(
                "names a file for --format, --json, --jsonl, --csv or --bop, or a folder for --glb and --png",
                param_hint="--output",
            )
    include: list[Include] = ["rejected"] if rejected else []
    if url is None:
        load(weights)  # what is wrong with the weights is wrong for all files
    with inputs.standard_input(files) as names:
        paths, missing = inputs.expand(names)
        try:
            listing = Listing(format, paths, Options(max_error, include), file)
        except ValueError as error:
            raise typer.BadParameter(str(error), param_hint="--format") from error
        shown = inputs.unlike(paths, lambda path: path.stem)
        task = Task(
            mode=mode,
            max_error=max_error,
            include=(*include, *listing.include),
            level=level,
            tolerance=tolerance,
            glb_folder=folder if glb else None,
            png_folder=folder if png else None,
            up=up,
            weights=weights,
            url=url,
            api_key=api_key,
            names={path: name for path, name in shown.items() if name != path.stem},
        )
        written = [place for path in paths for place in task.targets(path)]
        inputs.require_free(written if file is None else [*written, file], overwrite)
        outcomes = [Outcome(path, None, reason) for path, reason in missing]
        with listing.progress() as advance:
            for outcome in batch.run(paths, task, jobs or min(available_cores(), max(1, len(paths)))):
                outcomes.append(outcome)
                listing.add(outcome)
                advance()
        listing.end()
    raise typer.Exit(_report_failures(outcomes))


app.command()(editing.complete)
app.command()(editing.halve)
app.command()(editing.sector)
app.command()(editing.align)
app.command()(twins)


@app.command()
def warmup(weights: Weights = "default") -> None:
    """Compile and cache the kernels, and run one detection. Then the first answer comes fast."""
    from app.detection import MeshLimits, Options, parse_and_detect
    from app.workers import warmup as kernels

    started = time.perf_counter()
    detector = load(weights)
    kernels.warm_up(detector)
    loaded = time.perf_counter()
    filename, data = kernels.sample_files()[0]
    response = parse_and_detect(detector, data, filename, Options(), MeshLimits())
    typer.echo(
        f"{detector.name} {detector.version}: loaded and warmed up in {loaded - started:.1f} s; "
        f"a box has {len(response.planes)} planes and {len(response.axes)} axes, "
        f"found in {response.timings_ms.total:.1f} ms"
    )


def _report_failures(outcomes: list[Outcome]) -> Exit:
    """List what failed, and say how it went."""
    failed = [outcome for outcome in outcomes if outcome.response is None]
    if not failed:
        return Exit.OK
    if len(outcomes) > 1:
        typer.echo(f"{len(failed)} of {len(outcomes)} failed:", err=True)
    for outcome in failed:
        typer.echo(f"{outcome.path}: {outcome.error}", err=True)
    if all(outcome.unreachable for outcome in failed):
        return Exit.NO_SERVICE
    return Exit.ALL_FAILED if len(failed) == len(outcomes) else Exit.SOME_FAILED
