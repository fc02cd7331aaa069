"""The methods that `training evaluate --mode full` sets side by side; each turns a mesh into planes and axes.

All answers are in the coordinates of the mesh that was shown. Times are CPU time of the whole process: the load of
other processes on the machine does not count, nor do threads hide anything.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from functools import lru_cache, partial
from typing import Any, Literal

import numpy as np

from model.detection import Detection
from model.detector import Detector, use_one_thread
from model.geometry.frames import UnitFrame
from model.geometry.refinement import refine_planes
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.geometry.transforms import reflect
from model.meshes.mesh import Mesh
from model.paper.validation import MAX_ERROR
from model.search.full import Sources
from model.types import FloatArray
from training.baselines.classical import pca_planes
from training.evaluation.matching import Found, FoundAxis, same_plane
from training.oracle.groundtruth import find_symmetries
from training.shapes.solids import box

TITLES = {
    "full": "full mode",
    "paper": "paper mode",
    "pca": "PCA + refinement",
    "random": "random starts + refinement",
    "exhaustive": "exhaustive search",
}
"""What may be asked for, and what a table calls it; beside these ``full[SOURCE+SOURCE]`` (`ablation`)."""

RANDOM_STARTS = 72
"""So many random planes are refined (the figure that issue 3 compares with)."""

_START_SAMPLES, _SAMPLES = 300, 1000
_START_STEPS = 30


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What a method said of a mesh, in the mesh's coordinates, and the CPU ``milliseconds`` it took.

    Only a detector fills the rest: ``stages`` in wall-clock milliseconds, the ``point_group``, which elements, planes
    first, it calls ``exact``, and what it ``rejected``.
    """

    found: Found
    milliseconds: float
    stages: dict[str, float] = field(default_factory=dict[str, float])
    point_group: str | None = None
    exact: list[bool] | None = None
    rejected: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])


def ablation() -> list[str]:
    """Methods ``full[...]`` for every single source of proposals, all but one, and the network with each."""
    names = tuple(source.name for source in fields(Sources))
    sets: list[tuple[str, ...]] = [(name,) for name in names]
    sets += [(names[0], name) for name in names[1:]]
    sets += [tuple(other for other in names if other != name) for name in names]
    sets.append(names)
    return [f"full[{'+'.join(chosen)}]" for chosen in dict.fromkeys(sets)]


def check(methods: Sequence[str]) -> None:
    """Raise ValueError if one of ``methods`` is none."""
    for method in methods:
        if method not in TITLES:
            _sources(method)


def answer(method: str, weights: str, mesh: Mesh, max_error: float, seed: Sequence[int]) -> Answer:
    """Run a method, everything compiled and loaded beforehand.

    Args:
        method: see `TITLES`.
        weights: of the detector.
        mesh: what is shown.
        max_error: threshold on the SDE.
        seed: of the random starts.
    """
    run = _prepared(method, weights)
    started = time.process_time()
    found, detection = run(mesh, max_error, seed)
    spent = 1e3 * (time.process_time() - started)
    if detection is None:
        return Answer(found, spent)
    rejected = [
        {"kind": item.kind, "sde": item.symmetry_error, "reason": item.reason}
        | {key: getattr(item, key) for key in ("normal", "offset", "direction", "point")}
        for item in detection.rejected
    ]
    exact = [element.exact for element in (*detection.planes, *detection.axes)]
    return Answer(found, spent, dict(detection.timings_ms), detection.point_group, exact, rejected)


_Run = Callable[[Mesh, float, Sequence[int]], tuple[Found, Detection | None]]


@lru_cache
def _prepared(method: str, weights: str) -> _Run:
    """The method as a function that has already run once."""
    use_one_thread()
    run: _Run
    if method == "pca":
        run = _pca
    elif method == "random":
        run = _random
    elif method == "exhaustive":
        run = _exhaustive
    else:
        run = partial(_detect, _detector(weights), method)
    vertices, faces = box((1.0, 2.0, 3.0))
    run(Mesh.checked(vertices, faces), MAX_ERROR, (0,))
    return run


@lru_cache
def _detector(weights: str) -> Detector:
    detector = Detector.load(weights)
    detector.warm_up()
    return detector


def _detect(
    detector: Detector, method: str, mesh: Mesh, max_error: float, seed: Sequence[int]
) -> tuple[Found, Detection | None]:
    if method.startswith("full["):
        detection = detector.detect(mesh, max_error=max_error, sources=_sources(method))
    else:
        mode: Literal["full", "paper"] = "paper" if method == "paper" else "full"
        detection = detector.detect(mesh, mode=mode, max_error=max_error)
    planes = np.array([np.append(plane.normal, plane.offset) for plane in detection.planes]).reshape(-1, 4)
    axes = [FoundAxis(axis.direction, axis.point, None if axis.continuous else axis.order) for axis in detection.axes]
    return Found(planes, axes), detection


def _pca(mesh: Mesh, max_error: float, seed: Sequence[int]) -> tuple[Found, None]:
    frame = UnitFrame.of(mesh.vertices, mesh.faces)
    vertices = frame.to_unit(mesh.vertices)
    return _refined(frame, vertices, mesh, pca_planes(vertices, mesh.faces), max_error), None


def _random(mesh: Mesh, max_error: float, seed: Sequence[int]) -> tuple[Found, None]:
    frame = UnitFrame.of(mesh.vertices, mesh.faces)
    vertices = frame.to_unit(mesh.vertices)
    starts = np.random.default_rng(seed).normal(size=(RANDOM_STARTS, 3))
    starts /= np.linalg.norm(starts, axis=1, keepdims=True)
    return _refined(frame, vertices, mesh, np.column_stack([starts, np.zeros(len(starts))]), max_error), None


def _refined(frame: UnitFrame, vertices: FloatArray, mesh: Mesh, planes: FloatArray, max_error: float) -> Found:
    """Planes of the unit frame refined, rid of doubles, judged on other samples; what is left, in the mesh's frame.

    Refined on few samples first, then once more on many what is left: many starts end at the same few planes.
    """
    surface = SurfaceIndex(vertices, mesh.faces)
    judge, _ = sample_surface(vertices, mesh.faces, _SAMPLES, seed=2)
    coarse, _ = sample_surface(vertices, mesh.faces, _START_SAMPLES, seed=3)
    fine, _ = sample_surface(vertices, mesh.faces, _SAMPLES, seed=4)
    planes = _distinct(refine_planes(surface, coarse, planes, _START_STEPS), surface, judge, 2.0 * max_error)
    planes = _distinct(refine_planes(surface, fine, planes, _START_STEPS), surface, judge, max_error)
    return Found(np.array([frame.plane_to_input(plane) for plane in planes]).reshape(-1, 4))


def _distinct(planes: FloatArray, surface: SurfaceIndex, samples: FloatArray, max_error: float) -> FloatArray:
    """Planes within ``max_error``, sorted by error; of those closer than the tolerances of matching the best."""
    errors = np.array([surface.mean_squared_distance(reflect(samples, plane), max_error) for plane in planes])
    kept: list[FloatArray] = []
    for row in np.argsort(errors, kind="stable"):
        if errors[row] <= max_error and not any(same_plane(planes[row], other) for other in kept):
            kept.append(planes[row])
    return np.array(kept).reshape(-1, 4)


def _exhaustive(mesh: Mesh, max_error: float, seed: Sequence[int]) -> tuple[Found, None]:
    frame = UnitFrame.of(mesh.vertices, mesh.faces)
    truth = find_symmetries(mesh.vertices, mesh.faces)
    kept = truth.planes[truth.plane_errors <= max_error]
    planes = np.array([frame.plane_to_input(plane) for plane in kept]).reshape(-1, 4)
    axes = [
        FoundAxis(axis.direction, frame.to_input(axis.point), axis.order)
        for axis in truth.axes
        if axis.error <= max_error
    ]
    return Found(planes, axes), None


def _sources(method: str) -> Sources:
    """The sources that ``full[network+scan]`` names; ValueError if it names none."""
    chosen = method.removeprefix("full[").removesuffix("]").split("+")
    known = [source.name for source in fields(Sources)]
    if method != f"full[{'+'.join(chosen)}]" or not set(chosen) <= set(known):
        raise ValueError(
            f"there is no method {method!r}; known are {', '.join(TITLES)}, and full[] with some of {'+'.join(known)}"
        )
    return Sources(**{name: name in chosen for name in known})
