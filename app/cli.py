"""The command line: ``prsnet serve``, ``prsnet detect FILE...``, ``prsnet warmup``.

Exit codes: 0 all went well, 1 some files failed (or the server could not start), 2 wrong usage.
"""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from app.schemas import Mode

if TYPE_CHECKING:
    from app.detection import SymmetryDetector

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Find the mirror planes and rotation axes of 3D meshes.",
)

Weights = Annotated[str, typer.Option(help='"default", "paper", or the path of a .safetensors file.')]


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

    from app import server
    from app.settings import Settings
    from app.tracing import TracingNotInstalledError

    given: dict[str, Any] = {
        "host": host, "port": port, "workers": workers, "weights": weights, "log_level": log_level
    }  # fmt: skip
    try:
        settings = Settings(**{name: value for name, value in given.items() if value is not None})
    except ValidationError as error:
        # Environment variables may be at fault as well as options, so both names are told.
        faults = [f"{item['loc'][0]} (PRSNET_{str(item['loc'][0]).upper()}): {item['msg']}" for item in error.errors()]
        raise typer.BadParameter("; ".join(faults)) from error
    try:
        raise typer.Exit(server.serve(settings))
    except TracingNotInstalledError as error:
        raise typer.BadParameter(str(error)) from error


@app.command()
def detect(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Mesh files.", show_default=False)],
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object a line, as POST /detect answers.")] = False,
    mode: Annotated[Mode, typer.Option(help="full: refined; paper: the network's own output.")] = "full",
    max_error: Annotated[float, typer.Option(help="Largest symmetry error, unit frame.")] = 4e-4,
    weights: Weights = "default",
) -> None:
    """Find the symmetries of mesh files. Results go to standard output, failures to standard error."""
    from app.detection import MeshLimits, Options, parse_and_detect
    from app.report import print_report
    from app.schemas import to_json
    from model.errors import MeshError

    if not 0 < max_error <= 1:
        raise typer.BadParameter("must be over 0 and at most 1", param_hint="--max-error")
    options = Options(mode, max_error)
    detector = _load(weights)
    failed = False
    for path in files:
        try:
            response = parse_and_detect(detector, path.read_bytes(), path.name, options, MeshLimits())
        except OSError as error:
            typer.echo(f"{path}: {error.strerror}", err=True)
            failed = True
        except MeshError as error:
            typer.echo(f"{path}: {error}", err=True)
            failed = True
        else:
            if as_json:
                typer.echo(to_json(response, options.include))
            else:
                print_report(response)
    raise typer.Exit(1 if failed else 0)


@app.command()
def warmup(weights: Weights = "default") -> None:
    """Compile and cache the kernels, and run one detection. Then the first answer comes fast."""
    from app import warmup as kernels
    from app.detection import MeshLimits, Options, parse_and_detect

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
    from app.runtime import load_detector
    from model.errors import CheckpointError

    try:
        return load_detector(weights)
    except CheckpointError as error:
        raise typer.BadParameter(str(error), param_hint="--weights") from error
