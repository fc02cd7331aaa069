"""Pictures of an experiment: one figure of every method as bars, and shapes with what each method returned for them."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from model.geometry.frames import UnitFrame
from model.geometry.surface import SurfaceIndex
from model.geometry.transforms import reflect
from model.meshes.mesh import Mesh
from model.types import FloatArray
from training.evaluation.corruptions import corrupt
from training.evaluation.report import Column
from training.layouts import find_meshes, parse
from training.reproduction.solid_view import SolidView, sampled

_WORST = 0.1
"""Distance, unit frame, at which the colours of a gallery end."""

_ADDED = 0.02
"""Distance, unit frame, from what was shown, beyond which its mirror image adds something."""

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


@dataclass(frozen=True, slots=True, eq=False)
class _Scene:
    """A shape to draw: the ``intact`` one and what was ``shown`` of it, in the intact one's unit frame.

    ``view`` is of the intact one, ``points`` and ``normals`` are of what was shown, ``max_error`` is the threshold on
    the SDE.
    """

    view: SolidView
    intact: SurfaceIndex
    shown: SurfaceIndex
    points: FloatArray
    normals: FloatArray
    max_error: float

    @classmethod
    def of(cls, mesh: Mesh, damage: str, seed: tuple[int, int], max_error: float) -> "_Scene":
        """The scene of a shape as `training.evaluation.judging.judge` shows it."""
        shape = corrupt(mesh.vertices, mesh.faces, damage, *seed)
        places = shape.similarity.points_to_unit(shape.vertices)
        whole = UnitFrame.of(mesh.vertices, mesh.faces).to_unit(mesh.vertices)
        return cls(
            SolidView(*sampled(whole, mesh.faces)),
            SurfaceIndex(whole, mesh.faces, work=np.inf),
            SurfaceIndex(places, shape.faces, work=np.inf),
            *sampled(places, shape.faces),
            max_error,
        )


def draw_gallery(
    folders: Sequence[Path],
    records: Sequence[Mapping[str, Any]],
    figures: Mapping[str, Mapping[str, Any]],
    out: Mapping[str, Path],
    *,
    damage: str = "clean",
    seed: int = 0,
    max_error: float = 4e-4,
) -> None:
    """A row a shape, a column a method, a line of figures under each: shapes with what was returned for them.

    Args:
        folders: where the meshes are.
        records: of the shapes, as `training.evaluation.evaluate.evaluate` returns them.
        figures: the methods, with their titles.
        out: by the kind, one of `GALLERIES`, the PNG to write. ``planes`` and ``axes`` are of networks and detectors
            alone, which are what is validated and has axes, if there are any.
        damage: of the evaluation.
        seed: of the evaluation.
        max_error: threshold on the SDE.
    """
    detectors = {key: of for key, of in figures.items() if key.partition(":")[0] in ("raw", "paper", "full")} or figures
    columns = {kind: detectors if kind in ("planes", "axes") else figures for kind in out}
    pictures = {kind: _Grid(columns[kind], len(records)) for kind in out}
    files = {source.name: (index, source.path) for index, source in enumerate(find_meshes(folders))}
    for row, record in enumerate(records):
        index, path = files[record["name"]]
        scene = _Scene.of(parse(path.read_bytes(), path.name), damage, (seed, index), max_error)
        for kind, grid in pictures.items():
            for column, method in enumerate(columns[kind]):
                grid.show(row, column, *GALLERIES[kind](scene, record["methods"][method]))
    for kind, path in out.items():
        pictures[kind].picture.savefig(path, dpi=110)


class _Grid:
    """A picture of small ones, a column a method."""

    def __init__(self, figures: Mapping[str, Mapping[str, Any]], rows: int) -> None:
        narrow = ConstrainedLayoutEngine(w_pad=0.01, h_pad=0.02)
        self.picture = Figure(figsize=(1.45 * len(figures), 1.66 * rows + 0.5), layout=narrow)
        FigureCanvasAgg(self.picture)
        self._cells = self.picture.subplots(rows, len(figures), squeeze=False)
        for axes, of in zip(self._cells[0], figures.values(), strict=True):
            axes.set_title(of["title"].replace(", ", ",\n").replace(" with ", "\nwith "), fontsize=8)

    def show(self, row: int, column: int, image: FloatArray, below: str) -> None:
        axes = self._cells[row, column]
        axes.imshow(image, interpolation="bilinear")
        axes.set(xticks=[], yticks=[])
        axes.set_xlabel(below, fontsize=7, labelpad=1)
        for side in axes.spines.values():
            side.set_color("0.85")


def _best_plane(scene: _Scene, answer: Mapping[str, Any]) -> tuple[FloatArray, str]:
    """The best plane, the intact surface coloured by how far it is from the truth, as the paper's heat maps.

    A point's colour is the distance between its images in this plane and in the nearest clear one (grey where the shape
    has none), from none (dark) to 10 % of the unit frame (yellow).
    """
    view = scene.view
    if not answer["planes"]:
        return view.draw(_PALE), "no plane"
    best = int(np.argmin(answer["plane_sde"]))
    plane, colours = np.array(answer["planes"][best]), _GREY
    if answer["nearest"] is not None:
        gap = np.linalg.norm(reflect(view.points, plane) - reflect(view.points, np.array(answer["nearest"])), axis=1)
        colours = _heat(gap)
    return view.draw(colours, [(plane, _RED)]), f"SDE {answer['plane_sde'][best]:.0e}"


def _all_planes(scene: _Scene, answer: Mapping[str, Any]) -> tuple[FloatArray, str]:
    """All planes: green those within the threshold on the intact shape, red the others."""
    within = [error <= scene.max_error for error in answer["plane_sde"]]
    planes = [(np.array(plane), _GREEN if good else _RED) for plane, good in zip(answer["planes"], within, strict=True)]
    count = f"{len(planes)} plane{'s' if len(planes) != 1 else ''}"
    return scene.view.draw(_GREY if planes else _PALE, planes), f"{count}, {sum(within)} within t"


def _axes(scene: _Scene, answer: Mapping[str, Any]) -> tuple[FloatArray, str]:
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
    return scene.view.draw(_GREY if axes else _PALE, axes=axes), f"order {', '.join(names)}" if names else "no axis"


def _completed(scene: _Scene, answer: Mapping[str, Any]) -> tuple[FloatArray, str]:
    """What was shown, grey, and what its mirror image in the first plane adds.

    That is coloured by how far it is from the intact surface: dark where it is right, yellow where it is 10 % of the
    unit frame off.
    """
    if not answer["planes"]:
        return SolidView(scene.points, scene.normals).draw(_PALE), "no plane"
    plane = np.array(answer["planes"][0])
    images = reflect(scene.points, plane)
    added = scene.shown.squared_distances(images) > _ADDED**2
    images = images[added]
    away = np.sqrt(scene.intact.squared_distances(images))
    normals = reflect(scene.normals[added], np.array([*plane[:3], 0.0]))
    view = SolidView(np.concatenate([scene.points, images]), np.concatenate([scene.normals, normals]))
    colours = np.concatenate([np.broadcast_to(_GREY, scene.points.shape), _heat(away)])
    return view.draw(colours), f"{answer['surface_after']:.0%} there, {answer['surface_wrong']:.0%} false"


def _heat(distances: FloatArray) -> FloatArray:
    """Colours ``(n, 3)`` of distances ``(n,)``, unit frame."""
    return 0.12 + 0.88 * np.asarray(colormaps["viridis"](np.minimum(distances / _WORST, 1.0)))[:, :3]


GALLERIES: dict[str, Callable[[_Scene, Mapping[str, Any]], tuple[FloatArray, str]]] = {
    "best": _best_plane,
    "planes": _all_planes,
    "axes": _axes,
    "completed": _completed,
}
"""What a gallery shows of every answer."""
