"""What several commands share: their options, what they refuse, their exit codes."""

from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from app.detection import SymmetryDetector


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
MeshFile = Annotated[Path, typer.Argument(help="Mesh file; - for standard input.")]
OutputFile = Annotated[Path, typer.Option("--output", "-o", help="File to write: .ply, .glb, .obj or .stl.")]
Offset = Annotated[float, typer.Option(help="With --normal: the plane is normal·x + offset = 0.")]
Fem = Annotated[bool, typer.Option("--fem", help="Print the lines for CalculiX and FreeCAD.")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace files that are there already.")]
MaxError = Annotated[float, typer.Option(help="Largest symmetry error, unit frame (at most 1).")]


def load(weights: str) -> "SymmetryDetector":
    """The detector.

    Raises:
        typer.BadParameter: its weights cannot be used.
    """
    from app import local
    from model.errors import CheckpointError

    try:
        return local.detector_of(weights)
    except CheckpointError as error:
        raise typer.BadParameter(str(error), param_hint="--weights") from error


def require_max_error(max_error: float) -> None:
    """Refuse a threshold out of range."""
    if not 0 < max_error <= 1:
        raise typer.BadParameter("must be over 0 and at most 1", param_hint="--max-error")


def plane_of(normal: str | None, offset: float) -> list[float] | None:
    """The plane of two options, as four numbers."""
    from pydantic import ValidationError

    from app.queries import CompleteQuery

    try:
        return CompleteQuery(normal=normal, offset=offset if normal is not None else None).plane
    except ValidationError as error:
        raise typer.BadParameter(error.errors()[0]["msg"], param_hint="--normal") from error


def reason_of(error: Exception) -> str:
    """The reason of an error as one sentence."""
    return (isinstance(error, OSError) and error.strerror) or str(error)
