"""Draws the levels of five shapes for full-mode.md: `python -m docs.make_ladders`, from the root of the repository.

A mug, a gear with a hub, a can as scanned, a plate with a missing screw and half a chair, each as the detector sees it
and answers, with the levels below: the RMS deviation each needs, and the one that is answered with.
"""

import numpy as np
import trimesh
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from docs.make_pictures import ROOT, draw_group
from model import Detection, Detector, Mesh
from training.evaluation.imperfections import KINDS
from training.shapes.catalogue import generate

FINEST, CHOSEN, OTHER = 1e-6, "#00798c", "#b9c0cc"


def joined(*parts: trimesh.Trimesh) -> Mesh:
    """Parts as one mesh."""
    whole = trimesh.util.concatenate(parts)
    return Mesh.checked(np.array(whole.vertices), np.array(whole.faces))


def mug() -> Mesh:
    """Round but for its handle."""
    body = trimesh.creation.annulus(0.9, 1.0, 2.2, sections=64)
    floor = trimesh.creation.cylinder(0.9, 0.1, sections=64).apply_translation([0, 0, -1.05])
    handle = trimesh.creation.torus(0.6, 0.12).apply_transform(
        trimesh.transformations.rotation_matrix(np.pi / 2, [1, 0, 0])
    )
    return joined(body, floor, handle.apply_translation([1.35, 0, 0]))


def gear() -> Mesh:
    """18 teeth, a round bore and a key in it."""
    teeth = [
        trimesh.creation.box([0.3, 0.2, 0.4])
        .apply_translation([1.1, 0, 0])
        .apply_transform(trimesh.transformations.rotation_matrix(2 * np.pi * k / 18, [0, 0, 1]))
        for k in range(18)
    ]
    key = trimesh.creation.box([0.16, 0.2, 0.44]).apply_translation([0.52, 0, 0])
    return joined(trimesh.creation.annulus(0.5, 1.0, 0.4, sections=72), *teeth, key)


def can() -> Mesh:
    """Round, with noise of 0.1 % of the diagonal."""
    shape = generate("cylinder", np.random.default_rng(3))
    diagonal = float(np.linalg.norm(np.ptp(shape.vertices, axis=0)))
    return Mesh.checked(*KINDS["noise-0.1"](shape.vertices, shape.faces, np.random.default_rng(1), diagonal))


def plate() -> Mesh:
    """Four places for screws, three screws."""
    screws = [
        trimesh.creation.cylinder(0.35, 0.5, sections=32).apply_translation([4.0 * x, 2.0 * y, 0.6])
        for x, y in ((-1, -1), (-1, 1), (1, -1))
    ]
    return joined(trimesh.creation.box([10, 6, 0.8]), *screws)


def half_chair() -> Mesh:
    """What one depth image sees of a chair."""
    shape = generate("chair", np.random.default_rng(5))
    diagonal = float(np.linalg.norm(np.ptp(shape.vertices, axis=0)))
    return Mesh.checked(*KINDS["depth-1"](shape.vertices, shape.faces, np.random.default_rng(2), diagonal))


SHAPES = {
    "a mug": mug,
    "a gear with a key": gear,
    "a can as scanned": can,
    "a plate, one screw missing": plate,
    "half a chair": half_chair,
}


def draw_levels(axes: Axes, detection: Detection) -> None:
    """A bar for each level, from what it needs to what the next one needs, or to the threshold."""
    limit = 0.02
    for row, level in enumerate(detection.levels):
        start = max(level.rms_distance / detection.scale, FINEST)
        end = limit if level.next_rms_distance is None else level.next_rms_distance / detection.scale
        axes.barh(row, max(end - start, 0.0), left=start, height=0.6, color=CHOSEN if level.chosen else OTHER)
        sure = "exact" if level.exact else f"{100 * level.confidence:.0f} % sure"
        axes.text(FINEST, row + 0.36, f"{level.point_group}, {sure}", fontsize=8, va="bottom")
    axes.set(xscale="log", xlim=(FINEST, limit), ylim=(-0.5, max(len(detection.levels), 3)), yticks=[])
    axes.tick_params(labelsize=7)
    for side in ("top", "left", "right"):
        axes.spines[side].set_visible(False)


def main() -> None:
    """Write docs/images/ladders.png."""
    detector = Detector.load()
    figure = Figure(figsize=(13.5, 4.4), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, len(SHAPES), height_ratios=[2.6, 1.4])
    for column, (title, make) in enumerate(SHAPES.items()):
        detection = detector.detect(make())
        picture, bars = figure.add_subplot(grid[0, column]), figure.add_subplot(grid[1, column])
        picture.imshow(draw_group(detection, np.eye(3)))
        picture.set_axis_off()
        picture.set_title(f"{title}: {detection.point_group}", fontsize=10)
        draw_levels(bars, detection)
    figure.supxlabel("RMS deviation, unit frame", fontsize=8)
    figure.savefig(ROOT / "docs" / "images" / "ladders.png", dpi=110)


if __name__ == "__main__":
    main()
