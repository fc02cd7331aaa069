"""The detector: a mesh in, its symmetries out.

It works as a library:

>>> from model import Detector
>>> detector = Detector.load()
>>> detector.detect("chair.obj").planes
"""

import os
import time
from collections.abc import Mapping
from typing import Any, Literal, Self

import numpy as np
import torch

from model.checkpoint import Checkpoint, load_checkpoint
from model.detection import Axis, Detection, Plane, Rejected
from model.frames import UnitFrame
from model.mesh import Mesh, MeshLike, as_mesh
from model.point_group import TOLERANCE, point_group
from model.proposals import Proposals, fed_voxels, input_rotation, next_rotation, predict
from model.sampling import sample_surface
from model.surface import SurfaceIndex
from model.transforms import canonical_sign
from model.types import FloatArray, IntArray
from model.validation import MAX_ERROR, Judged, validate_axes, validate_planes

SAMPLES = 1000
"""Surface samples an element is judged on (the paper's N)."""

EXACT_ERROR = 1e-6
"""An SDE below this is symmetry up to modelling precision: 0.1 % of the bounding sphere's diameter RMS."""

FULL_IS_PAPER = "mode=full returns the paper's result in this version: nothing is refined and no group is completed."


class Detector:
    """A trained network with everything around it that turns a mesh into symmetries; several threads may share it."""

    def __init__(self, checkpoint: Checkpoint) -> None:
        self._checkpoint = checkpoint
        self.metadata: Mapping[str, Any] = checkpoint.metadata
        self.name = str(checkpoint.metadata["name"])
        self.version = str(checkpoint.metadata["version"])
        self.sha256 = str(checkpoint.metadata["sha256"])

    @classmethod
    def load(cls, weights: str | os.PathLike[str] = "default") -> Self:
        """Load shipped weights (``default``, ``paper``) or a `.safetensors` file with its `.json` beside it.

        Raises:
            CheckpointError: the weights are missing, damaged, or do not fit.
        """
        return cls(load_checkpoint(weights))

    def warm_up(self) -> None:
        """Compile or load every kernel and run the network once, so that the first request is as fast as the next."""
        corners = np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 2.0) for z in (0.0, 3.0)])
        quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
        faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], dtype=np.int32)
        mesh = Mesh.checked(corners, faces)
        self.detect(mesh)
        _ = mesh.bounds, mesh.area, mesh.watertight

    def detect(
        self, mesh: MeshLike, *, mode: Literal["full", "paper"] = "full", max_error: float = MAX_ERROR
    ) -> Detection:
        """Find the symmetries of a mesh.

        Args:
            mesh: a `Mesh`, a trimesh object, ``(vertices, faces)``, or the path of a file.
            mode: ``paper`` is the network's output and the paper's validation (section 5); ``full`` is the same until
                refinement and group completion are built, and says so in ``warnings``.
            max_error: largest accepted symmetry error (SDE, unit frame).

        Returns:
            planes and axes in the mesh's own coordinates, and what was rejected.

        Raises:
            MeshError: the mesh cannot be used; the subclass and the message say why.
        """
        started = time.perf_counter()
        mesh = as_mesh(mesh)
        frame = UnitFrame.of(mesh.vertices, mesh.faces)
        vertices = frame.to_unit(mesh.vertices)
        timings: dict[str, float] = {}
        proposals = self.propose(vertices, mesh.faces, timings)
        mark = time.perf_counter()
        surface = SurfaceIndex(vertices, mesh.faces)
        samples, _ = sample_surface(vertices, mesh.faces, SAMPLES, seed=0)
        planes = validate_planes(proposals.planes, surface, samples, max_error)
        axes = validate_axes(proposals.directions, proposals.angles, surface, samples, max_error)
        timings["refine"] = 0.0
        timings["validate"] = _since(mark)
        accepted_axes = [judged for judged in axes if judged.reason is None]
        directions = _rows([judged.vector for judged in accepted_axes])
        accepted_planes = [judged for judged in planes if judged.reason is None]
        rejected = [judged for judged in planes + axes if judged.reason is not None]
        result = Detection(
            planes=[_plane(judged, frame, directions) for judged in accepted_planes],
            axes=[_axis(judged, frame) for judged in accepted_axes],
            point_group=point_group(_rows([judged.vector[:3] for judged in accepted_planes]), directions),
            center=frame.center,
            scale=frame.scale,
            mesh=mesh,
            timings_ms=timings,
            warnings=[FULL_IS_PAPER] if mode == "full" else [],
            rejected=[_rejected(judged, frame) for judged in sorted(rejected, key=lambda item: item.error)],
        )
        timings["total"] = _since(started)
        return result

    def propose(self, vertices: FloatArray, faces: IntArray, timings: dict[str, float] | None = None) -> Proposals:
        """The network's raw planes and rotations for a shape in the unit frame, before any validation.

        Args:
            vertices: ``(v, 3)`` float64, unit frame.
            faces: ``(f, 3)`` int32.
            timings: if given, ``voxelize`` and ``infer`` are filled in, in milliseconds.
        """
        spent = {"voxelize": 0.0, "infer": 0.0}
        mark = time.perf_counter()
        rotation = input_rotation(self._checkpoint, vertices, faces)
        for step in range(self._checkpoint.input.passes):
            voxels = fed_voxels(self._checkpoint, vertices, faces, rotation)
            spent["voxelize"] += _since(mark)
            mark = time.perf_counter()
            proposals = predict(self._checkpoint, voxels, rotation)
            spent["infer"] += _since(mark)
            mark = time.perf_counter()
            if step + 1 < self._checkpoint.input.passes:
                rotation = next_rotation(proposals, rotation)
        if timings is not None:
            timings.update(spent)
        return proposals  # pyright: ignore[reportPossiblyUnboundVariable] - there is at least one pass


def use_one_thread() -> None:
    """One torch thread a worker: a network of this size gains nothing from more, and loses much under load."""
    torch.set_num_threads(1)


def _since(mark: float) -> float:
    return (time.perf_counter() - mark) * 1e3


def _rows(vectors: list[FloatArray]) -> FloatArray:
    return np.stack(vectors) if vectors else np.zeros((0, 3))


def _signed(vector: FloatArray) -> FloatArray:
    return vector * canonical_sign(vector) + 0.0  # no negative zeros


def _plane(judged: Judged, frame: UnitFrame, axes: FloatArray) -> Plane:
    plane = _signed(frame.plane_to_input(judged.vector))
    normal, offset = plane[:3], float(plane[3])
    return Plane(
        normal=normal,
        offset=offset,
        point=frame.center - (normal @ frame.center + offset) * normal,
        symmetry_error=judged.error,
        rms_distance=frame.scale * judged.error**0.5,
        exact=judged.error < EXACT_ERROR,
        continuous=bool((np.abs(axes @ normal) < np.sin(TOLERANCE)).any()),
    )


def _axis(judged: Judged, frame: UnitFrame) -> Axis:
    return Axis(
        direction=_signed(judged.vector),
        point=frame.center,
        order=None,
        continuous=True,
        symmetry_error=judged.error,
        rms_distance=frame.scale * judged.error**0.5,
        exact=judged.error < EXACT_ERROR,
    )


def _rejected(judged: Judged, frame: UnitFrame) -> Rejected:
    assert judged.reason is not None
    if len(judged.vector) == 4:
        plane = _signed(frame.plane_to_input(judged.vector))
        return Rejected("plane", judged.error, judged.reason, normal=plane[:3], offset=float(plane[3]))
    return Rejected("axis", judged.error, judged.reason, direction=_signed(judged.vector), point=frame.center)
