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

from model.detection import Detection
from model.formats.conversion import MeshLike, as_mesh
from model.geometry.frames import UnitFrame, canonical_signs, inertia_frame
from model.geometry.sampling import extreme_vertices, sample_surface
from model.geometry.scan import DistanceGrid, directions
from model.geometry.surface import SurfaceIndex
from model.meshes.mesh import Mesh
from model.network.checkpoint import Checkpoint, load_checkpoint
from model.network.proposals import (
    Proposals,
    input_rotation,
    next_rotation,
    predict_each,
    rotated_voxels,
)
from model.network.views import look, other_views
from model.paper.paper_mode import validate_proposals
from model.paper.validation import MAX_ERROR
from model.report import to_input
from model.search.full import Sources, find_symmetries
from model.search.judgement import MORE_SAMPLES, SAMPLES, Judge
from model.search.shape import Shape
from model.symmetries import Symmetries
from model.types import FloatArray, IntArray

REFINE_SAMPLES = 240
"""Surface samples that elements are refined on in full mode; they are judged on others."""

DIRECTION_STRIDE = 83
"""Vertices that are extreme in every so many-th direction of the scan, either way, are refined on too: at most 26."""

FULL_FRAMES = 1
"""Sign choices of the input frame that full mode looks at, in one batch: more cost time and found no more planes
(docs/decisions/0005-sources-of-starts.md)."""

ALL_SOURCES = Sources()


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
        for mode in ("full", "paper"):
            self.detect(mesh, mode=mode)
        _ = mesh.bounds, mesh.area, mesh.watertight

    def detect(
        self,
        mesh: MeshLike,
        *,
        mode: Literal["full", "paper"] = "full",
        max_error: float = MAX_ERROR,
        sources: Sources = ALL_SOURCES,
    ) -> Detection:
        """Find the symmetries of a mesh.

        Args:
            mesh: a `Mesh`, a trimesh object, ``(vertices, faces)``, or the path of a file.
            mode: ``full`` finds every symmetry, refined on the exact distance and completed to a group; ``paper`` is
                the network's output and the paper's validation (section 5).
            max_error: largest accepted symmetry error (SDE, unit frame).
            sources: where full mode takes its starts from, for ablations.

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
        if mode == "paper":
            found = self._paper(vertices, mesh.faces, max_error, timings)
        else:
            found = self._full(vertices, mesh.faces, max_error, sources, timings)
        result = to_input(found, frame, mesh, timings)
        timings["total"] = _since(started)
        return result

    def _paper(self, vertices: FloatArray, faces: IntArray, max_error: float, timings: dict[str, float]) -> Symmetries:
        proposals = self.propose(vertices, faces, timings)
        mark = time.perf_counter()
        surface = SurfaceIndex(vertices, faces)
        samples, _ = sample_surface(vertices, faces, SAMPLES, seed=0)
        found = validate_proposals(proposals, surface, samples, max_error)
        timings["refine"] = 0.0
        timings["validate"] = _since(mark)
        return found

    def _full(
        self,
        vertices: FloatArray,
        faces: IntArray,
        max_error: float,
        sources: Sources,
        timings: dict[str, float],
    ) -> Symmetries:
        mark = time.perf_counter()
        principal = canonical_signs(inertia_frame(vertices, faces)[0], vertices, faces)
        turn = principal if self._checkpoint.input.frame == "inertia" else np.eye(3)
        occupied = rotated_voxels(self._checkpoint, vertices, faces, turn)
        timings["voxelize"] = _since(mark)
        mark = time.perf_counter()
        proposals = predict_each(self._checkpoint, occupied, turn, FULL_FRAMES) if sources.network else None
        timings["infer"] = _since(mark)
        mark = time.perf_counter()
        surface = SurfaceIndex(vertices, faces)
        samples, _ = sample_surface(vertices, faces, REFINE_SAMPLES, seed=1)
        sides = directions()[::DIRECTION_STRIDE] @ principal
        anchors = extreme_vertices(vertices, faces, np.concatenate([sides, -sides]))
        judging, _ = sample_surface(vertices, faces, SAMPLES, seed=0)
        judge = Judge(surface, judging, max_error, lambda: sample_surface(vertices, faces, MORE_SAMPLES, seed=2)[0])
        shape = Shape(surface, samples, anchors, judge, DistanceGrid(occupied), turn, principal)
        found = find_symmetries(shape, proposals, sources)
        timings["validate"] = found.judging_ms
        timings["refine"] = _since(mark) - found.judging_ms
        return found

    def propose(self, vertices: FloatArray, faces: IntArray, timings: dict[str, float] | None = None) -> Proposals:
        """The network's raw planes and rotations for a shape in the unit frame, before any validation.

        Args:
            vertices: ``(v, 3)`` float64, unit frame.
            faces: ``(f, 3)`` int32.
            timings: if given, ``voxelize`` and ``infer`` are filled in, in milliseconds.
        """
        checkpoint, spent = self._checkpoint, {"voxelize": 0.0, "infer": 0.0}
        mark = time.perf_counter()
        rotation = input_rotation(checkpoint, vertices, faces)
        for left in reversed(range(checkpoint.input.passes)):
            rotations = [rotation] if left or checkpoint.input.views == 1 else [rotation, *other_views(rotation)]
            grids = [rotated_voxels(checkpoint, vertices, faces, turn) for turn in rotations]
            spent["voxelize"] += _since(mark)
            mark = time.perf_counter()
            proposals = look(checkpoint, grids, rotations)
            spent["infer"] += _since(mark)
            mark = time.perf_counter()
            if left:
                rotation = next_rotation(proposals, rotation)
        if timings is not None:
            timings.update(spent)
        return proposals  # pyright: ignore[reportPossiblyUnboundVariable] - there is at least one pass


def use_one_thread() -> None:
    """One torch thread a worker: a network of this size gains nothing from more, and loses much under load."""
    torch.set_num_threads(1)


def _since(mark: float) -> float:
    return (time.perf_counter() - mark) * 1e3
