"""``prsnet twins``: whether two parts are the same, mirror images of each other, or neither."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.cli.options import Exit, reason_of

if TYPE_CHECKING:
    from model.meshes.mesh import Mesh

_WORDS = {
    "congruent": "congruent: the same part, not its mirror image",
    "mirror_images": "mirror images of each other, not congruent: a left and a right one",
    "both": "congruent, and mirror images as well: the part is its own mirror image",
    "neither": "neither congruent nor mirror images",
}


def twins(
    first: Annotated[Path, typer.Argument(help="Mesh file.")],
    second: Annotated[Path, typer.Argument(help="Mesh file it is laid on.")],
    tolerance: Annotated[
        float | None,
        typer.Option(help="Largest deviation that counts as none, input units (default: 0.0005 of the size)."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="JSON: relation, deviations, 4x4 matrices.")] = False,
) -> None:
    """Tell whether two parts are congruent, mirror images of each other, or neither, and how one is laid on the other.

    Exit codes: 0 congruent or mirror images, 1 neither, or a file could not be read, 2 wrong usage.
    """
    from model.comparison.twins import compare
    from model.errors import MeshError
    from model.formats.conversion import as_mesh

    if tolerance is not None and not tolerance > 0:
        raise typer.BadParameter("must be over 0", param_hint="--tolerance")
    meshes: list[Mesh] = []
    for path in (first, second):
        try:
            meshes.append(as_mesh(path))
            for warning in meshes[-1].warnings:
                typer.echo(f"{path}: warning: {warning}", err=True)
        except (OSError, MeshError) as error:
            typer.echo(f"{path}: {reason_of(error)}", err=True)
            raise typer.Exit(Exit.SOME_FAILED) from error
    found = compare(*meshes, tolerance=tolerance)
    best = found.mirrored if found.relation == "mirror_images" else found.direct
    if as_json:
        content = {
            "relation": found.relation,
            "tolerance": found.tolerance,
            "direct": {"deviation": found.direct.deviation, "matrix": found.direct.matrix.tolist()},
            "mirrored": {"deviation": found.mirrored.deviation, "matrix": found.mirrored.matrix.tolist()},
        }
        typer.echo(json.dumps(content))
    else:
        typer.echo(f"{first}, {second}: {_WORDS[found.relation]}")
        typer.echo(
            f"  largest deviation: {found.direct.deviation:.3g} as they are, {found.mirrored.deviation:.3g} mirrored "
            f"(up to {found.tolerance:.3g} counts as none)"
        )
        if found.relation != "neither":
            for row in best.matrix.tolist():
                typer.echo("  " + " ".join(f"{value + 0.0:15.9g}" for value in row))
    raise typer.Exit(Exit.SOME_FAILED if found.relation == "neither" else Exit.OK)
