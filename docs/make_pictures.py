"""Draws the pictures of README.md and accuracy.md from the shipped weights: `python docs/make_pictures.py`.

Every picture shows what `Detector.detect` answers; nothing is drawn by hand. Run from the root of the repository.
"""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from app.outputs.rendering import Scene, camera
from model import Detection, Detector
from model.meshes.mesh import Mesh
from training.shapes.catalogue import generate

ROOT = Path(__file__).parents[1]
Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])

GROUPS: dict[str, list[tuple[str, dict[str, Any] | None]]] = {
    "groups_1.png": [
        ("chair.obj", None),
        ("table.glb", None),
        ("vase.ply", None),
        ("cyclic", {"n": 5}),
        ("prism", {"n": 6}),
    ],
    "groups_2.png": [
        ("improper", {"n": 6}),
        ("antiprism", {"n": 5}),
        ("spindle", {}),
        ("orbit", {"group": "O"}),
        ("polyhedron", {"solid": "dodecahedron"}),
    ],
}
"""Two sheets of five: files of tests/data (Kenney and Quaternius, CC0-1.0), families of `training.shapes.catalogue`."""

PLANE_COLOUR, FAMILY_COLOUR = "#00798c", "#edae49"
AXIS_COLOURS = {2: "#444444", 3: "#2e8b57", 4: "#d1495b", 5: "#8e44ad", 6: "#c77700"}
PIXELS = 330
SEED = 2
CONTINUOUS_COLOUR, OTHER_ORDER_COLOUR = "#d4a017", "#1f4fbf"


def draw_group(detection: Detection, turn: np.ndarray) -> np.ndarray:
    """The mesh with all planes as translucent discs and all axes as rods through their true places, as an image."""
    mesh, half = detection.mesh, 0.5 * detection.scale
    scene = Scene(camera(-55.0, 22.0), turn @ detection.center, 1.12 * half)
    scene.add_triangles(mesh.vertices[mesh.faces] @ turn.T, np.array([0.86, 0.88, 0.92]))
    alpha = 0.45 / max(1.0, len(detection.planes)) ** 0.7
    for plane in detection.planes:
        colour = np.array(to_rgb(FAMILY_COLOUR if plane.continuous else PLANE_COLOUR))
        scene.add_disc(turn @ plane.point, turn @ plane.normal, 0.98 * half, colour, alpha)
    thickness = half * (0.018 if len(detection.axes) < 8 else 0.012)
    for axis in detection.axes:
        colour = CONTINUOUS_COLOUR if axis.order is None else AXIS_COLOURS.get(axis.order, OTHER_ORDER_COLOUR)
        ends = np.stack([axis.point + side * 1.1 * half * axis.direction for side in (-1.0, 1.0)])
        scene.add_tube(ends @ turn.T, thickness * (1.6 if axis.continuous else 1.0), np.array(to_rgb(colour)))
    return scene.image(PIXELS)


def shape_of(name: str, parameters: dict[str, Any] | None) -> tuple[Any, np.ndarray]:
    """A mesh to detect, and the turn that puts its upright axis along z."""
    if parameters is None:
        return ROOT / "tests" / "data" / name, Y_UP
    shape = generate(name, np.random.default_rng(SEED), **parameters)
    return Mesh.checked(shape.vertices, shape.faces), np.eye(3)


def counted(detection: Detection) -> str:
    """How many planes and axes, as a caption says it; how many hold within the threshold only, if any."""
    planes, axes = len(detection.planes), len(detection.axes)
    similar = sum(not element.exact for element in (*detection.planes, *detection.axes))
    text = f"{planes} plane{'' if planes == 1 else 's'}, {axes} ax{'i' if axes == 1 else 'e'}s"
    return text + (f" ({similar} similar only)" if similar else "")


def main() -> None:
    """Write the two sheets of groups."""
    detector = Detector.load()
    for file, shapes in GROUPS.items():
        figure = Figure(figsize=(15, 3.55))
        figure.subplots_adjust(left=0.0, right=1.0, bottom=0.0, top=0.85, wspace=0.01)
        FigureCanvasAgg(figure)
        for index, (name, parameters) in enumerate(shapes):
            mesh, turn = shape_of(name, parameters)
            detection = detector.detect(mesh)
            axes = figure.add_subplot(1, len(shapes), index + 1)
            axes.imshow(draw_group(detection, turn), interpolation="none")
            axes.set_axis_off()
            axes.set_title(f"{detection.point_group}\n{counted(detection)}", fontsize=12)
        save(figure, file)


def save(figure: Figure, name: str) -> None:
    """Write a sheet to docs/images."""
    out = ROOT / "docs" / "images" / name
    figure.savefig(out, dpi=110)
    print(f"wrote {out}, {out.stat().st_size // 1024} KB")


if __name__ == "__main__":
    main()
