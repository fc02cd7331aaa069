"""Draws the shapes the shipped network errs on most: `python docs/make_failures.py CORPUS/test`.

Every mesh of the folder is shown in a random pose with a ball missing, as `training evaluate --damage partial` shows
it. The six whose best plane lies farthest from every clear plane (GTE), one a source, go to
docs/images/network_failures.png: the mesh as it is shown, in red the network's best plane, in teal the closest clear
one.
"""

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from app.outputs.rendering import Scene, camera
from model import Detector
from model.formats import read_mesh
from model.geometry.frames import UnitFrame
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.geometry.transforms import reflect
from model.types import FloatArray, IntArray
from training.evaluation.corruptions import corrupt
from training.evaluation.matching import nearest_clear_plane
from training.layouts import find_meshes
from training.oracle.truth import Truth, load

ROOT = Path(__file__).parents[1]
TRUTH = ROOT / "docs/runs/groundtruth/corpus-test.json"
COUNT = 6
PIXELS = 300
RED, TEAL, GREY = np.array([0.82, 0.29, 0.36]), np.array([0.0, 0.47, 0.55]), np.array([0.86, 0.88, 0.92])


class Failure(NamedTuple):
    """One shape as it was shown, in its own unit frame, with the wrong plane and the true one."""

    name: str
    gte: float
    vertices: FloatArray
    faces: IntArray
    said: FloatArray
    true: FloatArray


def judge(detector: Detector, path: Path, name: str, index: int, truth: Truth) -> Failure | None:
    """The network's best plane against the closest clear one, in the unit frame of the mesh as shown."""
    mesh = read_mesh(path.read_bytes(), path.name)
    intact = UnitFrame.of(mesh.vertices, mesh.faces).to_unit(mesh.vertices)
    shown = corrupt(mesh.vertices, mesh.faces, "partial", 0, index)
    frame = UnitFrame.of(shown.vertices, shown.faces)
    vertices = frame.to_unit(shown.vertices)
    raw = detector.propose(vertices, shown.faces).planes
    planes = shown.similarity.planes_to_unit(np.array([frame.plane_to_input(plane) for plane in raw]))
    surface = SurfaceIndex(intact, mesh.faces)
    samples, _ = sample_surface(intact, mesh.faces, 1500, seed=7919)
    errors = [surface.mean_squared_distance(reflect(samples, plane)) for plane in planes]
    best = int(np.argmin(errors))
    true = nearest_clear_plane(truth, planes[best])
    if true is None:
        return None
    gte = float(np.square(true - planes[best]).sum())
    back = frame.plane_to_unit(shown.similarity.planes_to_shown(true[None])[0])
    return Failure(name, gte, vertices, shown.faces, raw[best], back)


def draw(failure: Failure) -> np.ndarray:
    """The mesh and both planes, as an image, from a side from which neither plane is seen edge-on."""
    scene = Scene(camera(-55.0, 22.0), np.zeros(3), 0.56)
    scene.add_triangles(failure.vertices[failure.faces], GREY)
    for plane, colour in ((failure.true, TEAL), (failure.said, RED)):
        scene.add_disc(-plane[3] * plane[:3], plane[:3], 0.5, colour, 0.4)
    return scene.image(PIXELS)


def main(folder: Path) -> None:
    """Judge all, draw the worst."""
    truths = load(TRUTH)
    detector = Detector.load()
    failures: dict[str, Failure] = {}
    for index, source in enumerate(find_meshes([folder])):
        found = judge(detector, source.path, source.name, index, truths[source.name]) if source.name in truths else None
        group = source.category or source.source
        if found is not None and (group not in failures or found.gte > failures[group].gte):
            failures[group] = found
    worst = sorted(failures.values(), key=lambda failure: -failure.gte)[:COUNT]
    figure = Figure(figsize=(2.5 * COUNT, 2.9), layout="constrained")
    for axes, failure in zip(figure.subplots(1, COUNT), worst, strict=True):
        axes.imshow(draw(failure))
        axes.set_axis_off()
        axes.set_title(f"{failure.name.split('/', 1)[1][-34:]}\nGTE {failure.gte:.2g}", fontsize=7)
    FigureCanvasAgg(figure).print_png(ROOT / "docs/images/network_failures.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
