"""A detection as tables a person can read, for ``prsnet detect``."""

import math

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from app.schemas import Axis, DetectResponse, Level, Patch, Plane


def print_report(response: DetectResponse, console: Console | None = None) -> None:
    """Print what was found in one mesh: a headline, a table of planes, a table of axes, the warnings."""
    console = console or Console(highlight=False)
    if not console.is_terminal:
        console.width = 120  # into a pipe or a file: never cut at the 80 columns rich assumes there
    mesh = response.mesh
    console.print(
        f"[bold]{escape(mesh.filename)}[/bold]  {mesh.vertices} vertices, {mesh.faces} faces  "
        f"point group [bold]{response.point_group}[/bold]  {response.timings_ms.total:.1f} ms"
    )
    if response.planes:
        console.print(_planes(response.planes))
    if response.axes:
        console.print(_axes(response.axes))
    if not response.planes and not response.axes:
        console.print(f"  no symmetry found{_nearest(response)}")
    for level in response.levels:
        console.print(_level(level))
        for patch in level.breaks:
            console.print(
                f"    {'broken' if patch.present else 'missing'} at {_vector(patch.center)}, {_extent(patch)}"
            )
    for warning in response.warnings:
        console.print(f"  [yellow]warning:[/yellow] {escape(warning)}")
    console.print()


def _nearest(response: DetectResponse) -> str:
    """The best of what was turned down, and the threshold without which it cannot be taken."""
    turned_down = [item for item in response.rejected if item.reason == "not_symmetric"]
    if not turned_down:
        return ""
    best = min(turned_down, key=lambda item: item.symmetry_error)
    direction = best.normal if best.kind == "plane" else best.direction
    error = best.symmetry_error
    return (
        f"; the best candidate is the {best.kind} {_vector(direction)} with an error of {error:.2g}, "
        f"which needs at least --max-error {rounded_up(error):.2g}"
    )


def rounded_up(error: float) -> float:
    """A number of two digits that is not smaller."""
    step = 10.0 ** (math.floor(math.log10(error)) - 1) if error > 0 else 1.0
    return min(1.0, math.ceil(error / step * 1.001) * step)


def _planes(planes: list[Plane]) -> Table:
    table = _table("plane: normal", "offset")
    for plane in planes:
        table.add_row(
            _vector(plane.normal),
            f"{plane.offset:.6g}",
            *_quality(plane),
            "on a continuous axis" * plane.continuous + "predicted, not measured" * (plane.evidence == "predicted"),
        )
    return table


def _axes(axes: list[Axis]) -> Table:
    table = _table("axis: direction", "order")
    for axis in axes:
        table.add_row(_vector(axis.direction), str(axis.order or "any angle"), *_quality(axis), _through(axis))
    return table


def _level(level: Level) -> str:
    needs = f"rms distance {level.rms_distance:.2e}" if level.rms_distance else "exactly"
    missing = f", {100 * level.missing:.0f} % missing" if level.missing >= 0.005 else ""
    sure = "" if level.confidence == 1.0 else f", {100 * level.confidence:.0f} % sure"
    predicted = ", predicted" * (level.evidence == "predicted")
    return (
        f"  level [bold]{level.point_group}[/bold]  {needs}{missing}{predicted}{sure}{'  (this answer)' * level.chosen}"
    )


def _extent(patch: Patch) -> str:
    return f"size {patch.size:.3g}, off by {patch.max_distance:.3g}"


def _table(*first: str) -> Table:
    table = Table(box=None, pad_edge=True, header_style="dim")
    for heading in (*first, "error", "rms distance", "exact", ""):
        table.add_column(heading, justify="left" if heading in ("", first[0]) else "right", overflow="fold")
    return table


def _quality(found: Plane | Axis) -> tuple[str, str, str]:
    return f"{found.symmetry_error:.1e}", f"{found.rms_distance:.2e}", "yes" if found.exact else "no"


def _through(axis: Axis) -> str:
    return f"through {_vector(axis.point)}"


def _vector(values: list[float]) -> str:
    return "(" + ", ".join(f"{round(value, 4) + 0.0:.4f}" for value in values) + ")"  # + 0.0: no "-0.0000"
