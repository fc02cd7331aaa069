"""A contact sheet of the ground truth: every shape with its clear planes, to be looked through by eye."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from model.geometry.frames import UnitFrame
from training.layouts import find_meshes, parse
from training.oracle.known_truth import truth_of
from training.oracle.truth import Truth
from training.reproduction.solid_view import SolidView, sampled

_COLUMNS = 12
_GREY, _GREEN = np.full(3, 0.72), np.array([0.05, 0.55, 0.2])


def draw_contact_sheet(folders: Sequence[Path], names: Sequence[str], known: Mapping[str, Truth], out: Path) -> None:
    """Shapes with their clear planes, and how many planes and continuous axes are clear.

    Args:
        folders: where the meshes are.
        names: of the shapes.
        known: their symmetries; of a shape that is not among them they are searched.
        out: PNG to write.
    """
    files = {source.name: source.path for source in find_meshes(folders)}
    rows = -(-len(names) // _COLUMNS)
    narrow = ConstrainedLayoutEngine(w_pad=0.01, h_pad=0.01)
    picture = Figure(figsize=(1.45 * _COLUMNS, 1.62 * rows), layout=narrow)
    FigureCanvasAgg(picture)
    cells = picture.subplots(rows, _COLUMNS, squeeze=False).ravel()
    for axes in cells:
        axes.set(xticks=[], yticks=[])
        for side in axes.spines.values():
            side.set_color("0.85")
    for axes, name in zip(cells, names, strict=False):
        mesh = parse(files[name].read_bytes(), files[name].name)
        frame = UnitFrame.of(mesh.vertices, mesh.faces)
        truth, _ = truth_of(files[name], mesh, frame, known.get(name))
        view = SolidView(*sampled(frame.to_unit(mesh.vertices), mesh.faces))
        planes = truth.clear_planes()
        axes.imshow(view.draw(_GREY, [(plane, _GREEN) for plane in planes]), interpolation="bilinear")
        endless = sum(axis.order is None for axis in truth.clear_axes())
        axes.set_xlabel(f"{len(planes)} clear{', round' if endless else ''}", fontsize=7, labelpad=1)
    picture.savefig(out, dpi=75)
