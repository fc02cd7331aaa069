"""The command line: ``prsnet detect``, ``complete``, ``halve``, ``serve``, ``warmup``.

Exit codes: 0 all went well; 1 some files failed, or the server could not start; 2 wrong usage; 3 no file had an answer;
4 the service of ``--url`` is not there; 130 interrupted.
"""

import time
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from app import __version__
from app.cli.batch import Outcome, Task
from app.schemas import Include, LevelName, Mode

if TYPE_CHECKING:
    from app.detection import SymmetryDetector

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    epilog="Exit codes: 0 all went well, 1 some files failed, 2 wrong usage, 3 all files failed, "
    "4 the service of --url is not there.",
)


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


class Exit(IntEnum):
    """What the process tells a script."""

    OK = 0
    SOME_FAILED = 1
    USAGE = 2
    ALL_FAILED = 3
    NO_SERVICE = 4


Weights = Annotated[str, typer.Option(help='"default", "paper", or the path of a .safetensors file.')]
Url = Annotated[str | None, typer.Option(help="Address of a running service to ask instead of computing here.")]
ApiKey = Annotated[str | None, typer.Option(envvar="PRSNET_API_KEY", help="Key for that service, if it wants one.")]
MeshFile = Annotated[Path, typer.Argument(help="Mesh file.")]
OutputFile = Annotated[Path, typer.Option("--output", "-o", help="File to write: .ply, .glb, .obj or .stl.")]
Offset = Annotated[float, typer.Option(help="With --normal: the plane is normal·x + offset = 0.")]
MaxError = Annotated[float, typer.Option(help="Largest symmetry error, unit frame (at most 1).")]


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
    from app.settings import Settings

    given: dict[str, Any] = {
        "host": host, "port": port, "workers": workers, "weights": weights, "log_level": log_level
    }  # fmt: skip
    try:
        settings = Settings(**{name: value for name, value in given.items() if value is not None})
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
        typer.Argument(metavar="FILE...", help="Mesh files, folders of them, patterns.", show_default=False),
    ],
    as_json: Annotated[bool, typer.Option("--json", help="JSON as POST /detect answers; a list if several.")] = False,
    as_lines: Annotated[bool, typer.Option("--jsonl", help="JSON, one line a file, as soon as it is there.")] = False,
    as_csv: Annotated[bool, typer.Option("--csv", help="A row a plane or axis.")] = False,
    as_bop: Annotated[bool, typer.Option("--bop", help="A models_info.json for a BOP data set.")] = False,
    format: Annotated[str | None, typer.Option(help="Print in a format; a wrong name lists them.")] = None,
    glb: Annotated[bool, typer.Option("--glb", help="Also write NAME-symmetries.glb with planes and axes.")] = False,
    png: Annotated[bool, typer.Option("--png", help="Also write a picture NAME-symmetries.png.")] = False,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for these files.")] = Path(),
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
    """Find the symmetries of mesh files. Results go to standard output, what failed is listed on standard error.

    Exit codes: 0 all went well, 1 some files failed, 2 wrong usage, 3 all failed, 4 the service is not there.
    """
    from app.cli import batch
    from app.cli.listing import LINES, TABLE, Listing
    from app.outputs.output_format import Options
    from app.settings import available_cores

    _require_max_error(max_error)
    if tolerance is not None and not 0 < tolerance <= 1e60:
        raise typer.BadParameter("must be more than 0", param_hint="--tolerance")
    shorthands = {"json": as_json, LINES: as_lines, "csv": as_csv, "bop": as_bop}
    formats = [name for name, asked in shorthands.items() if asked] + ([format] if format else [])
    if len(formats) > 1:
        raise typer.BadParameter("at most one of --format, --json, --jsonl, --csv and --bop")
    if up not in (None, "y", "z"):
        raise typer.BadParameter("must be y or z", param_hint="--up")
    if glb or png:
        output.mkdir(parents=True, exist_ok=True)
    paths, failed = batch.expand(files)
    include: list[Include] = ["rejected"] if rejected else []
    try:
        listing = Listing(*formats or [TABLE], many=len(paths) > 1, options=Options(max_error, include))
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--format") from error
    task = Task(
        mode=mode,
        max_error=max_error,
        include=(*include, *listing.include),
        level=level,
        tolerance=tolerance,
        glb_folder=output if glb else None,
        png_folder=output if png else None,
        up=up,
        weights=weights,
        url=url,
        api_key=api_key,
    )
    if url is None:
        _load(weights)  # what is wrong with the weights is wrong for all files
    outcomes: list[Outcome] = list(failed)
    with listing.progress(len(paths)) as advance:
        for outcome in batch.run(paths, task, jobs or min(available_cores(), max(1, len(paths)))):
            outcomes.append(outcome)
            listing.add(outcome)
            advance()
    listing.end()
    raise typer.Exit(_report_failures(outcomes))


@app.command()
def complete(
    file: MeshFile,
    output: OutputFile,
    normal: Annotated[str | None, typer.Option(help="Plane to mirror at, as x,y,z (default: the best found).")] = None,
    offset: Offset = 0.0,
    symmetrize: Annotated[bool, typer.Option("--symmetrize", help="Also average both halves.")] = False,
    max_error: MaxError = 4e-4,
    weights: Weights = "default",
    url: Url = None,
    api_key: ApiKey = None,
) -> None:
    """Complete a mesh by its mirror image: what is there stays, what is missing is taken from the other side."""
    from app import local
    from app.client.client import Client
    from app.client.errors import ClientError, UnreachableError
    from model.errors import MeshError

    _require_max_error(max_error)
    plane = _plane(normal, offset)
    try:
        format = local.mesh_format(output)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--output") from error
    options: dict[str, Any] = {"plane": plane, "symmetrize": symmetrize, "max_error": max_error}
    try:
        if url is None:
            _load(weights)
            done = local.complete(file, weights=weights, **options)
        else:
            with Client(url, api_key=api_key) as client:
                done = client.complete(file, format=format, **options)
        done.save(output)
    except (OSError, MeshError, ClientError) as error:
        typer.echo(f"{file}: {_reason(error)}", err=True)
        raise typer.Exit(Exit.NO_SERVICE if isinstance(error, UnreachableError) else Exit.SOME_FAILED) from error
    what = done.completion
    typer.echo(
        f"{output}: {what.faces_kept} faces kept, {what.faces_added} added "
        f"({100 * what.area_added:.1f} % of the surface); seam closed over {what.seam_distance:.2g}; "
        f"plane with an error of {what.plane.symmetry_error:.1e}"
    )


@app.command()
def halve(
    file: MeshFile,
    output: OutputFile,
    normal: Annotated[str | None, typer.Option(help="Plane to cut at, as x,y,z (default: the best found).")] = None,
    offset: Offset = 0.0,
    other: Annotated[bool, typer.Option("--other", help="Keep the side the normal points away from.")] = False,
    max_error: MaxError = 4e-4,
    weights: Weights = "default",
) -> None:
    """Keep one half of a symmetric mesh, cut exactly at the plane and open there."""
    from app import local
    from model.errors import MeshError

    _require_max_error(max_error)
    plane: Any = _plane(normal, offset)
    try:
        writer = local.writer_for(output)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--output") from error
    try:
        if plane is None:
            _load(weights)
            planes = local.detect(file, max_error=max_error, weights=weights).planes
            if not planes:
                typer.echo(f"{file}: no mirror plane has an error of at most {max_error:g}", err=True)
                raise typer.Exit(Exit.SOME_FAILED)
            plane = planes[0]
        vertices, faces = local.halve(file, plane, positive=not other)
        output.write_bytes(writer.file(vertices, faces))
    except (OSError, MeshError) as error:
        typer.echo(f"{file}: {_reason(error)}", err=True)
        raise typer.Exit(Exit.SOME_FAILED) from error
    typer.echo(f"{output}: {len(faces)} faces")


@app.command()
def warmup(weights: Weights = "default") -> None:
    """Compile and cache the kernels, and run one detection. Then the first answer comes fast."""
    from app.detection import MeshLimits, Options, parse_and_detect
    from app.workers import warmup as kernels

    started = time.perf_counter()
    detector = _load(weights)
    kernels.warm_up(detector)
    loaded = time.perf_counter()
    filename, data = kernels.sample_files()[0]
    response = parse_and_detect(detector, data, filename, Options(), MeshLimits())
    typer.echo(
        f"{detector.name} {detector.version}: loaded and warmed up in {loaded - started:.1f} s; "
        f"a box has {len(response.planes)} planes and {len(response.axes)} axes, "
        f"found in {response.timings_ms.total:.1f} ms"
    )


def _load(weights: str) -> "SymmetryDetector":
    from app import local
    from model.errors import CheckpointError

    try:
        return local.detector_of(weights)
    except CheckpointError as error:
        raise typer.BadParameter(str(error), param_hint="--weights") from error


def _require_max_error(max_error: float) -> None:
    if not 0 < max_error <= 1:
        raise typer.BadParameter("must be over 0 and at most 1", param_hint="--max-error")


def _plane(normal: str | None, offset: float) -> list[float] | None:
    """The plane of two options, as four numbers."""
    from pydantic import ValidationError

    from app.queries import CompleteQuery

    try:
        return CompleteQuery(normal=normal, offset=offset if normal is not None else None).plane
    except ValidationError as error:
        raise typer.BadParameter(error.errors()[0]["msg"], param_hint="--normal") from error


def _reason(error: Exception) -> str:
    return (isinstance(error, OSError) and error.strerror) or str(error)


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
