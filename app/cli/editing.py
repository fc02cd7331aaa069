"""``prsnet complete``, ``halve``, ``sector`` and ``align``: meshes made from a mesh and its symmetries."""

import time
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from app.cli.inputs import require_free, standard_input
from app.cli.options import (
    ApiKey,
    Exit,
    Fem,
    MaxError,
    MeshFile,
    Offset,
    OutputFile,
    Overwrite,
    Url,
    Weights,
    load,
    plane_of,
    reason_of,
    require_max_error,
)


def complete(
    file: MeshFile,
    output: OutputFile,
    normal: Annotated[str | None, typer.Option(help="Plane to mirror at, as x,y,z (default: the best found).")] = None,
    offset: Offset = 0.0,
    symmetrize: Annotated[bool, typer.Option("--symmetrize", help="Also average both halves.")] = False,
    overwrite: Overwrite = False,
    max_error: MaxError = 4e-4,
    weights: Weights = "default",
    url: Url = None,
    api_key: ApiKey = None,
) -> None:
    """Complete a mesh by its mirror image: what is there stays, what is missing is taken from the other side."""
    from app import local
    from app.client.client import Client

    require_max_error(max_error)
    options: dict[str, Any] = {"plane": plane_of(normal, offset), "symmetrize": symmetrize, "max_error": max_error}
    with _output(file, output, overwrite) as source:
        if url is None:
            load(weights)
            done = local.complete(source, weights=weights, **options)
        else:
            with Client(url, api_key=api_key) as client:
                done = client.complete(source, format=local.mesh_format(output), **options)
        done.save(output)
    what = done.completion
    _warn(file, what.warnings)
    typer.echo(
        f"{output}: {what.faces_kept} faces kept, {what.faces_added} added "
        f"({100 * what.area_added:.1f} % of the surface); seam closed over {what.seam_distance:.2g}; "
        f"plane with an error of {what.plane.symmetry_error:.1e}"
    )


def halve(
    file: MeshFile,
    output: OutputFile,
    normal: Annotated[str | None, typer.Option(help="Plane to cut at, as x,y,z (default: the best found).")] = None,
    offset: Offset = 0.0,
    other: Annotated[bool, typer.Option("--other", help="Keep the side the normal points away from.")] = False,
    capped: Annotated[bool, typer.Option("--capped", help="Close the cut, so that half a solid is a solid.")] = False,
    fem: Fem = False,
    overwrite: Overwrite = False,
    max_error: MaxError = 4e-4,
    weights: Weights = "default",
    url: Url = None,
    api_key: ApiKey = None,
) -> None:
    """Keep one half of a symmetric mesh, cut exactly at the plane, open there or capped."""
    from app import local
    from app.client.client import Client

    require_max_error(max_error)
    options: dict[str, Any] = {
        "plane": plane_of(normal, offset), "positive": not other, "capped": capped, "max_error": max_error
    }  # fmt: skip
    with _output(file, output, overwrite) as source:
        if url is None:
            load(weights)
            made = local.halve(source, weights=weights, **options)
        else:
            with Client(url, api_key=api_key) as client:
                made = client.halve(source, format=local.mesh_format(output), **options)
        made.save(output)
    done = made.half
    _warn(file, done.warnings)
    typer.echo(
        f"{output}: {done.faces} faces, the {done.side} side of the plane "
        f"({', '.join(f'{value:.6g}' for value in done.normal)}), offset {done.offset:.6g}{_capped(done.capped)}"
    )
    if fem:
        _print_lines(done.calculix, done.freecad)


def sector(
    file: MeshFile,
    output: OutputFile,
    order: Annotated[
        int | None, typer.Option(help="How many sectors make up the whole (default: the order of the axis).")
    ] = None,
    axis: Annotated[
        str | None, typer.Option(help="Direction of the axis, as x,y,z, with --order (default: the one found).")
    ] = None,
    point: Annotated[str | None, typer.Option(help="With --axis: a point on it, as x,y,z (0,0,0).")] = None,
    start: Annotated[
        str | None, typer.Option(help="Way from the axis of the first cut, as x,y,z (default: where cuts are short).")
    ] = None,
    leave_open: Annotated[bool, typer.Option("--open", help="Leave the cuts open instead of closing them.")] = False,
    fem: Fem = False,
    overwrite: Overwrite = False,
    max_error: MaxError = 4e-4,
    weights: Weights = "default",
    url: Url = None,
    api_key: ApiKey = None,
) -> None:
    """Keep one of n equal sectors of a mesh with a rotation axis, cut exactly at two planes through it."""
    from app import local
    from app.client.client import Client
    from app.queries import SectorQuery
    from app.refusals import require

    try:
        query = require(SectorQuery, order=order, axis=axis, point=point, start=start, max_error=max_error)
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    options: dict[str, Any] = {"order": order, "start": query.way, "capped": not leave_open, "max_error": max_error}
    if query.line is not None:
        options |= {"axis": query.line[:3], "point": query.line[3:]}
    with _output(file, output, overwrite) as source:
        if url is None:
            load(weights)
            made = local.sector(source, weights=weights, **options)
        else:
            with Client(url, api_key=api_key) as client:
                made = client.sector(source, format=local.mesh_format(output), **options)
        made.save(output)
    done = made.sector
    _warn(file, done.warnings)
    ends = " to ".join(f"({', '.join(f'{value:.6g}' for value in end)})" for end in done.ends)
    typer.echo(
        f"{output}: {done.faces} faces, one of {done.order} sectors of {done.angle:.6g} degrees "
        f"about the axis {ends}{_capped(done.capped)}"
    )
    if fem:
        _print_lines(done.calculix, done.freecad)


def align(
    file: MeshFile,
    output: OutputFile,
    overwrite: Overwrite = False,
    max_error: MaxError = 4e-4,
    weights: Weights = "default",
    url: Url = None,
    api_key: ApiKey = None,
) -> None:
    """Turn and shift a copy of a mesh: its symmetry plane onto YZ, its main axis onto Z."""
    from app import local
    from app.client.client import Client
    from app.editing import AlignOptions, align_mesh
    from model.formats.conversion import as_mesh

    require_max_error(max_error)
    with _output(file, output, overwrite) as source:
        if url is None:
            started = time.perf_counter()
            detector, mesh = load(weights), as_mesh(source, looks=True)
            answer, moved = align_mesh(
                detector, mesh, file.name, AlignOptions(max_error), started, time.perf_counter()
            )  # fmt: skip
            done = answer.alignment
            output.write_bytes(local.writer_for(output).file(moved.vertices, moved.faces, moved.colors, moved.texture))
        else:
            with Client(url, api_key=api_key) as client:
                received = client.align(source, format=local.mesh_format(output), max_error=max_error)
            done = received.alignment
            received.save(output)
    _warn(file, done.warnings)
    rows = "; ".join(" ".join(f"{value:.9g}" for value in row) for row in done.matrix)
    typer.echo(f"{output}: point group {done.point_group}, moved by {rows}")


def _capped(capped: bool) -> str:
    return ", capped" if capped else ", open where it was cut"


def _print_lines(calculix: str, freecad: str) -> None:
    typer.echo(f"\n** CalculiX\n{calculix}\n# FreeCAD\n{freecad}", nl=False)


def _warn(file: Path, warnings: Iterable[str]) -> None:
    for warning in warnings:
        typer.echo(f"{file}: warning: {warning}", err=True)


@contextmanager
def _output(file: Path, output: Path, overwrite: bool) -> Generator[Path, None, None]:
    """The file to read, while one is made from it; what goes wrong is told and ends the command."""
    from app import local
    from app.client.errors import ClientError, UnreachableError
    from model.errors import MeshError

    try:
        local.writer_for(output)
    except ValueError as error:
        raise typer.BadParameter(str(error), param_hint="--output") from error
    require_free([output], overwrite)
    with standard_input([str(file)]) as (name,):
        try:
            yield Path(name)
        except (OSError, MeshError, ClientError) as error:
            typer.echo(f"{file}: {reason_of(error)}", err=True)
            raise typer.Exit(Exit.NO_SERVICE if isinstance(error, UnreachableError) else Exit.SOME_FAILED) from error
