"""Classical baselines as methods of an evaluation, and what may be done with the planes of any method."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from model.geometry.frames import UnitFrame
from model.geometry.refinement import refine_planes
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.geometry.transforms import reflect
from model.meshes.mesh import Mesh
from model.paper.validation import validate_planes
from model.types import FloatArray
from training.baselines import Baseline
from training.evaluation.matching import Found, FoundAxis, same_plane
from training.evaluation.method import Answer, Method
from training.oracle.groundtruth import find_symmetries

_START_SAMPLES, _SAMPLES = 300, 1000
_STEPS = 30


@dataclass(frozen=True, slots=True)
class Classical:
    """The planes of a module of `training.baselines`."""

    baseline: Baseline

    @property
    def title(self) -> str:
        """What a table calls it."""
        return self.baseline.TITLE

    def __call__(self, mesh: Mesh, seed: Sequence[int]) -> Answer:
        """`training.evaluation.method.Method`."""
        frame = UnitFrame.of(mesh.vertices, mesh.faces)
        planes = self.baseline.find_planes(frame.to_unit(mesh.vertices), mesh.faces, np.random.default_rng(seed))
        return Answer(Found(_to_input(frame, planes)))


@dataclass(slots=True)
class Reused:
    """A method that keeps its last answer, for what is done with the planes of one that has just run on its own."""

    method: Method
    _last: tuple[Mesh, Sequence[int], Answer] | None = None

    @property
    def title(self) -> str:
        """What a table calls it."""
        return self.method.title

    def __call__(self, mesh: Mesh, seed: Sequence[int]) -> Answer:
        """`training.evaluation.method.Method`; of the same mesh object the answer is that of the last call."""
        if self._last is not None and self._last[0] is mesh and self._last[1] == seed:
            return self._last[2]
        started = time.process_time()
        answer = self.method(mesh, seed)
        spent = 1e3 * (time.process_time() - started)
        self._last = mesh, seed, replace(answer, reused_ms=answer.reused_ms + spent)
        return answer


@dataclass(frozen=True, slots=True)
class Refined:
    """The planes of another method refined on exact distances, rid of doubles, judged on other samples.

    Refined on few samples first, then once more on many what is left: many starts end at the same few planes.
    """

    method: Method
    max_error: float

    @property
    def title(self) -> str:
        """What a table calls it."""
        return f"{self.method.title} + refinement"

    def __call__(self, mesh: Mesh, seed: Sequence[int]) -> Answer:
        """`training.evaluation.method.Method`."""
        frame = UnitFrame.of(mesh.vertices, mesh.faces)
        vertices = frame.to_unit(mesh.vertices)
        given = self.method(mesh, seed)
        planes = _to_unit(frame, given.found.planes)
        surface = SurfaceIndex(vertices, mesh.faces)
        judge, _ = sample_surface(vertices, mesh.faces, _SAMPLES, seed=2)
        coarse, _ = sample_surface(vertices, mesh.faces, _START_SAMPLES, seed=3)
        fine, _ = sample_surface(vertices, mesh.faces, _SAMPLES, seed=4)
        for samples, limit in ((coarse, 2.0 * self.max_error), (fine, self.max_error)):
            if len(planes):
                planes = _distinct(refine_planes(surface, samples, planes, _STEPS), surface, judge, limit)
        return Answer(Found(_to_input(frame, planes)), reused_ms=given.reused_ms)


@dataclass(frozen=True, slots=True)
class Validated:
    """What the paper's validation (section 5) leaves of the planes of another method."""

    method: Method
    max_error: float

    @property
    def title(self) -> str:
        """What a table calls it."""
        return f"{self.method.title}, validated"

    def __call__(self, mesh: Mesh, seed: Sequence[int]) -> Answer:
        """`training.evaluation.method.Method`."""
        frame = UnitFrame.of(mesh.vertices, mesh.faces)
        vertices = frame.to_unit(mesh.vertices)
        samples, _ = sample_surface(vertices, mesh.faces, _SAMPLES, seed=2)
        given = self.method(mesh, seed)
        planes = _to_unit(frame, given.found.planes)
        judged = validate_planes(planes, SurfaceIndex(vertices, mesh.faces), samples, self.max_error)
        kept = np.array([item.vector for item in judged if item.reason is None]).reshape(-1, 4)
        return Answer(Found(_to_input(frame, kept)), reused_ms=given.reused_ms)


@dataclass(frozen=True, slots=True)
class Exhaustive:
    """The search that makes the ground truth, seconds a shape."""

    max_error: float
    title: str = "exhaustive search"

    def __call__(self, mesh: Mesh, seed: Sequence[int]) -> Answer:
        """`training.evaluation.method.Method`."""
        frame = UnitFrame.of(mesh.vertices, mesh.faces)
        truth = find_symmetries(mesh.vertices, mesh.faces)
        axes = [
            FoundAxis(axis.direction, frame.to_input(axis.point), axis.order)
            for axis in truth.axes
            if axis.error <= self.max_error
        ]
        return Answer(Found(_to_input(frame, truth.planes[truth.plane_errors <= self.max_error]), axes))


def _distinct(planes: FloatArray, surface: SurfaceIndex, samples: FloatArray, max_error: float) -> FloatArray:
    """Planes within ``max_error``, sorted by error; of those closer than the tolerances of matching the best."""
    errors = np.array([surface.mean_squared_distance(reflect(samples, plane), max_error) for plane in planes])
    kept: list[FloatArray] = []
    for row in np.argsort(errors, kind="stable"):
        if errors[row] <= max_error and not any(same_plane(planes[row], other) for other in kept):
            kept.append(planes[row])
    return np.array(kept).reshape(-1, 4)


def _to_input(frame: UnitFrame, planes: FloatArray) -> FloatArray:
    return np.array([frame.plane_to_input(plane) for plane in planes]).reshape(-1, 4)


def _to_unit(frame: UnitFrame, planes: FloatArray) -> FloatArray:
    return np.array([frame.plane_to_unit(plane) for plane in planes]).reshape(-1, 4)
