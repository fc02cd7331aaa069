"""Pictures of an experiment: one figure of every method as bars, and shapes with the planes of every method."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from model.geometry.frames import UnitFrame
from model.geometry.sampling import sample_surface
from model.geometry.transforms import reflect
from model.types import FloatArray
from training.evaluation.report import Column
from training.layouts import find_meshes, parse

_POINTS = 1500
_WORST = 0.1
"""Distance, unit frame, at which the colours of a gallery end."""

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
) -> None:
    """A row a shape, a column a method: the best plane, the surface coloured by how far it is from the truth.

    As the paper's heat maps: a point's colour is the distance between its images in the method's plane and in the
    nearest clear one (grey where the shape has none), from none (dark) to 10 % of the unit frame (yellow).

    Args:
        folders: where the meshes are.
        records: of the shapes, as `training.evaluation.evaluate.evaluate` returns them.
        figures: the methods, with their titles.
        out: PNG to write.
    """
    files = {source.name: source.path for source in find_meshes(folders)}
    picture = Figure(figsize=(1.7 * len(figures), 1.9 * len(records) + 0.4), layout="constrained")
    FigureCanvasAgg(picture)
    cells = picture.subplots(len(records), len(figures), squeeze=False, subplot_kw={"projection": "3d"})
    for row, record in enumerate(records):
        mesh = parse(files[record["name"]].read_bytes(), files[record["name"]].name)
        vertices = UnitFrame.of(mesh.vertices, mesh.faces).to_unit(mesh.vertices)
        points, _ = sample_surface(vertices, mesh.faces, _POINTS, seed=0)
        for column, (method, of) in enumerate(figures.items()):
            axes = cells[row, column]
            axes.set_axis_off()
            axes.set_box_aspect((1, 1, 1))
            axes.set(xlim=(-0.45, 0.45), ylim=(-0.45, 0.45), zlim=(-0.45, 0.45))
            if row == 0:
                axes.set_title(of["title"], fontsize=6)
            answer = record["methods"][method]
            if not answer["planes"]:
                axes.scatter(*points.T, s=1, c="0.8")
                continue
            plane = np.array(answer["planes"][int(np.argmin(answer["plane_sde"]))])
            colours: Any = "0.6"
            if answer["nearest"] is not None:
                gap = np.linalg.norm(reflect(points, plane) - reflect(points, np.array(answer["nearest"])), axis=1)
                colours = np.minimum(gap, _WORST)
            axes.scatter(*points.T, s=1, c=colours, vmin=0.0, vmax=_WORST, cmap="viridis")
            axes.plot_surface(*_square(plane), color="tab:red", alpha=0.25)
    picture.savefig(out, dpi=110)


def _square(plane: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A square of the plane (n, d) about the point nearest to the origin: its corners as a 2 x 2 grid."""
    first, second = np.linalg.svd(plane[None, :3])[2][1:]
    corners = [[-plane[3] * plane[:3] + 0.4 * (a * first + b * second) for b in (-1, 1)] for a in (-1, 1)]
    x, y, z = np.moveaxis(np.array(corners), 2, 0)
    return x, y, z
