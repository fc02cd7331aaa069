"""Draws the README's pictures from the shipped weights and tests/data: `python docs/make_pictures.py`.

Every picture shows what `Detector.detect` answers in paper mode; nothing is drawn by hand.
"""

from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from model import Detection, Detector

ROOT = Path(__file__).parents[1]
EXAMPLES = ("chair.obj", "table.glb", "vase.ply", "plant.off")
COLOURS = ("#d1495b", "#00798c", "#edae49")


def draw(axes: object, detection: Detection) -> None:
    """Shaded triangles, planes as translucent squares through their points, continuous axes as lines. y is up."""
    mesh, turn = detection.mesh, np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    corners = mesh.vertices[mesh.faces] @ turn.T
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    light = 0.35 + 0.6 * np.abs(normals @ np.array([0.4, -0.6, 0.69]))
    axes.add_collection3d(Poly3DCollection(corners, facecolors=np.outer(light, [0.72, 0.76, 0.82])))
    half = 0.42 * detection.scale
    for plane, colour in zip(detection.planes, COLOURS, strict=False):
        normal, point = turn @ plane.normal, turn @ plane.point
        first = np.cross(normal, [0.0, 0.0, 1.0] if abs(normal[2]) < 0.9 else [1.0, 0.0, 0.0])
        first /= np.linalg.norm(first)
        second = np.cross(normal, first)
        square = [point + half * (a * first + b * second) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        axes.add_collection3d(Poly3DCollection([square], facecolors=colour, alpha=0.28, edgecolors=colour))
    for axis in detection.axes:
        ends = turn @ np.stack([axis.point + s * 1.3 * half * axis.direction for s in (-1, 1)], axis=1)
        axes.plot(*ends, color="black", linewidth=2)
    center = turn @ detection.center
    for name, middle in zip("xyz", center, strict=True):
        getattr(axes, f"set_{name}lim")(middle - half, middle + half)
    axes.set_box_aspect((1, 1, 1), zoom=1.25)
    axes.set_axis_off()
    axes.view_init(elev=22, azim=-55)


def main() -> None:
    """Write docs/images/examples.png."""
    detector = Detector.load()
    figure = Figure(figsize=(12, 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    for index, name in enumerate(EXAMPLES):
        detection = detector.detect(ROOT / "tests" / "data" / name, mode="paper")
        axes = figure.add_subplot(1, len(EXAMPLES), index + 1, projection="3d", computed_zorder=True)
        draw(axes, detection)
        errors = ", ".join(f"{plane.symmetry_error:.0e}" for plane in detection.planes) or "no plane"
        axes.set_title(f"{name}: {detection.point_group}\n{errors}", fontsize=10)
    out = ROOT / "docs" / "images" / "examples.png"
    figure.savefig(out, dpi=110)
    print(f"wrote {out}")


if __name__ == "__main__":
    main()
