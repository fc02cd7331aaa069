"""Pictures of an experiment: one figure of every method as bars, and shapes with what each method returned for them."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from model.geometry.frames import UnitFrame
from model.geometry.transforms import reflect
from model.types import FloatArray
from training.evaluation.report import Column
from training.layouts import find_meshes, parse
from training.reproduction.solid_view import SolidView

_WORST = 0.1
"""Distance, unit frame, at which the colours of a gallery end."""

_GREY, _PALE = np.full(3, 0.72), np.full(3, 0.88)
_RED, _GREEN, _ORANGE = np.array([0.85, 0.1, 0.1]), np.array([0.05, 0.55, 0.2]), np.array([0.95, 0.5, 0.0])

_WIDE = 20.0
"""Bars whose lengths differ by such a factor are drawn on a logarithmic scale."""


def draw_chart(figures: Mapping[str, Mapping[str, Mapping[str, Any]]], column: Column, out: Path) -> None:
    """Bars of one figure: ``figures`` by damage, by method; ``column`` of `training.evaluation.report`."""
    key, title, form = column
    methods = list(dict.fromkeys(method for of in figures.values() for method in of))
    picture = Figure(figsize=(9, 1.2 + 0.32 * len(methods) * len(figures)), layout="constrained")
    FigureCanvasAgg(picture)
    axes = picture.subplots()
    height = 0.8 / len(figures)
    labels = [next(of[method]["title"] for of in figures.values() if method in of) for method in methods]
    for row, (damage, of) in enumerate(figures.items()):
        values = [float(of.get(method, {}).get(key, np.nan)) for method in methods]
        places = np.arange(len(methods)) + row * height
        bars = axes.barh(places, values, height * 0.9, label=damage)
        axes.bar_label(bars, [form.format(value) if np.isfinite(value) else "" for value in values], padding=3, size=7)
        shown = [value for value in values if np.isfinite(value)]
        if min(shown, default=0.0) > 0 and max(shown) > _WIDE * min(shown) and not form.endswith("%}"):
            axes.set_xscale("log")
    axes.set_yticks(np.arange(len(methods)) + 0.4 - height / 2, labels, fontsize=8)
    axes.invert_yaxis()
    axes.set_title(title, fontsize=10)
    axes.margins(x=0.15, y=0.01)
    if len(figures) > 1:
        axes.legend(fontsize=7)
    picture.savefig(out, dpi=110)


def draw_gallery(
    folders: Sequence[Path],
    records: Sequence[Mapping[str, Any]],
    figures: Mapping[str, Mapping[str, Any]],
    out: Path,
    kind: str = "best",
    max_error: float = 4e-4,
) -> None:
    """A row a shape, a column a method, a line of figures under each: intact shapes with what was returned.

    Args:
        folders: where the meshes are.
        records: of the shapes, as `training.evaluation.evaluate.evaluate` returns them.
        figures: the methods, with their titles.
        out: PNG to write.
        kind: one of `GALLERIES`.
        max_error: threshold on the SDE.
    """
    files = {source.name: source.path for source in find_meshes(folders)}
    draw = GALLERIES[kind]
    narrow = ConstrainedLayoutEngine(w_pad=0.01, h_pad=0.02)
    picture = Figure(figsize=(1.45 * len(figures), 1.66 * len(records) + 0.5), layout=narrow)
    FigureCanvasAgg(picture)
    cells = picture.subplots(len(records), len(figures), squeeze=False)
    for row, record in enumerate(records):
        mesh = parse(files[record["name"]].read_bytes(), files[record["name"]].name)
        view = SolidView(UnitFrame.of(mesh.vertices, mesh.faces).to_unit(mesh.vertices), mesh.faces)
        for column, (method, of) in enumerate(figures.items()):
            axes = cells[row, column]
            image, below = draw(view, record["methods"][method], max_error)
            axes.imshow(image, interpolation="bilinear")
            axes.set(xticks=[], yticks=[])
            axes.set_xlabel(below, fontsize=7, labelpad=1)
            for side in axes.spines.values():
                side.set_color("0.85")
            if row == 0:
                axes.set_title(of["title"].replace(", ", ",\n").replace(" with ", "\nwith "), fontsize=8)
    picture.savefig(out, dpi=110)


def _best_plane(view: SolidView, answer: Mapping[str, Any], max_error: float) -> tuple[FloatArray, str]:
    """The best plane, the surface coloured by how far it is from the truth, as the paper's heat maps.

    A point's colour is the distance between its images in this plane and in the nearest clear one (grey where the shape
    has none), from none (dark) to 10 % of the unit frame (yellow).
    """
    if not answer["planes"]:
        return view.draw(_PALE), "no plane"
    best = int(np.argmin(answer["plane_sde"]))
    plane, colours = np.array(answer["planes"][best]), _GREY
    if answer["nearest"] is not None:
        gap = np.linalg.norm(reflect(view.points, plane) - reflect(view.points, np.array(answer["nearest"])), axis=1)
        colours = 0.12 + 0.88 * np.asarray(colormaps["viridis"](np.minimum(gap / _WORST, 1.0)))[:, :3]
    return view.draw(colours, [(plane, _RED)]), f"SDE {answer['plane_sde'][best]:.0e}"


def _all_planes(view: SolidView, answer: Mapping[str, Any], max_error: float) -> tuple[FloatArray, str]:
    """All planes: green those within the threshold on the intact shape, red the others."""
    within = [error <= max_error for error in answer["plane_sde"]]
    planes = [(np.array(plane), _GREEN if good else _RED) for plane, good in zip(answer["planes"], within, strict=True)]
    count = f"{len(planes)} plane{'s' if len(planes) != 1 else ''}"
    return view.draw(_GREY if planes else _PALE, planes), f"{count}, {sum(within)} within t"


def _axes(view: SolidView, answer: Mapping[str, Any], max_error: float) -> tuple[FloatArray, str]:
    """All axes: orange the continuous ones, green those of an order; the orders below, in brackets how many."""
    axes = [
        (np.array(axis["direction"]), np.array(axis["point"]), _GREEN if axis["order"] else _ORANGE)
        for axis in answer["axes"]
    ]
    orders = Counter(axis["order"] or 0 for axis in answer["axes"])
    names = [
        f"{order or '∞'}{f' ({count})' if count > 1 else ''}"
        for order, count in sorted(orders.items(), key=lambda pair: -(pair[0] or np.inf))
    ]
    return view.draw(_GREY if axes else _PALE, axes=axes), f"order {', '.join(names)}" if names else "no axis"


GALLERIES: dict[str, Callable[[SolidView, Mapping[str, Any], float], tuple[FloatArray, str]]] = {
    "best": _best_plane,
    "planes": _all_planes,
    "axes": _axes,
}
"""What a gallery shows of every answer."""
