"""The detector: a mesh in, its symmetries out.

It works as a library:

>>> from model import Detector
>>> detector = Detector.load()
>>> detector.detect("chair.obj").planes
"""

import os
import sys
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, NamedTuple, Self

import numpy as np

from model.detection import Detection
from model.errors import TooComplexError
from model.formats.conversion import MeshLike, as_mesh
from model.geometry.integrals import principal_frame, unit_frame
from model.geometry.sampling import SurfaceSampler, extreme_vertices, sample_surface
from model.geometry.scan import DistanceGrid, directions
from model.geometry.surface import SurfaceIndex, warm_up_cells
from model.geometry.topology import are_equal, welded
from model.meshes.bodies import inner_faces
from model.meshes.mesh import Mesh
from model.network.checkpoint import Checkpoint, load_checkpoint
from model.network.output import NetworkOutput
from model.network.proposals import (
    Proposals,
    input_rotation,
    next_rotation,
    rotated_voxels,
)
from model.network.views import look, other_views
from model.paper.paper_mode import validate_proposals
from model.paper.validation import MAX_ERROR
from model.report import inside_warning, to_input
from model.search.answer import LevelChoice, answer
from model.search.confidence import NAMES, is_certain, learned
from model.search.context import SearchContext
from model.search.deviation import DeviationMeter, SurfaceSamples
from model.search.exactness import ExactnessTest, clusters, resolution_of
from model.search.full import Found, Sources, find_symmetries
from model.search.part import fits_better
from model.search.prediction import guesses, likeliest
from model.search.settings import DEFAULT
from model.symmetries import Symmetries
from model.types import FloatArray, IntArray

_OUTERMOST = 0.5 + 1e-9
"""Unit frame: no point of a surface is farther from its centre."""

DIRECTION_STRIDE = 83
"""Vertices that are extreme in every so many-th direction of the scan, either way, are refined on too: at most 26."""

ALL_SOURCES = Sources()


class _Places(NamedTuple):
    """For every vertex the first at its place, unit frame, and whether every edge then belongs to two faces."""

    first: IntArray
    all_paired: bool


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
        learned("measured", NAMES)
        welded(corners[faces.ravel()], np.arange(faces.size, dtype=np.int32).reshape(-1, 3))
        frame = unit_frame(corners, faces[2:])
        context, network, _ = self.search(frame.to_unit(corners), faces[2:])
        context.meter.facets.sagittas_of(np.zeros(1, dtype=np.int32))
        if network is not None:
            likeliest(guesses(context, network))
        for mode in ("full", "paper"):
            self.detect(mesh, mode=mode)
            self.detect(Mesh.checked(corners, faces[2:]), mode=mode)  # an open box takes other ways
        warm_up_cells(corners, faces)
        clusters(corners)  # of what breaks a symmetry, which nothing of this box does
        inner_faces(np.concatenate([corners, corners / 2.0 + 0.1]), np.concatenate([faces, faces + 8]))
        _ = mesh.bounds, mesh.area, mesh.watertight

    def detect(
        self,
        mesh: MeshLike,
        *,
        mode: Literal["full", "paper"] = "full",
        max_error: float = MAX_ERROR,
        level: Literal["auto", "exact"] = "auto",
        tolerance: float | None = None,
        sources: Sources = ALL_SOURCES,
    ) -> Detection:
        """Find the symmetries of a mesh.

        Args:
            mesh: a `Mesh`, a trimesh object, ``(vertices, faces)``, or the path of a file.
            mode: ``full`` finds every symmetry, refined on the exact distance, as groups that hold as a whole;
                ``paper`` is the network's output and the paper's validation (section 5).
            max_error: largest accepted symmetry error (SDE, unit frame).
            level: which of the groups that hold is answered with. ``auto``: the one with the most room above it,
                before a larger one holds; ``exact``: the largest that holds everywhere, up to what the file promises.
            tolerance: instead of a ``level`` an RMS deviation in the mesh's own unit: the largest group within it.
            sources: where full mode takes its candidates from, for ablations.

        Returns:
            planes and axes of one symmetry group in the mesh's own coordinates, all groups that hold as levels, and the
            candidates that were left over.

        Raises:
            MeshError: the mesh cannot be used; the subclass and the message say why.
        """
        started = time.perf_counter()
        mesh = as_mesh(mesh)
        own, faces = welded(mesh.vertices, mesh.faces)
        frame = unit_frame(own, faces)
        vertices = frame.to_unit(own)
        resolution = _resolution(mesh, own, vertices) / frame.scale
        timings: dict[str, float] = {}
        notes: tuple[str, ...] = ()
        watertight: bool | None = None
        if mode == "paper":
            found = self._paper(vertices, faces, max_error, timings)
        else:
            choice = LevelChoice(level, None if tolerance is None else tolerance / frame.scale)
            found, places = self._full(vertices, faces, resolution, max_error, choice, sources, timings)
            mark = time.perf_counter()
            notes = self._inside_warning(found, places.first, vertices, faces, resolution, max_error, choice, sources)
            if are_equal(own, places.first):
                watertight = places.all_paired
            timings["validate"] += _since(mark)
        result = to_input(found, frame, mesh, resolution, max_error, timings, notes, watertight)
        timings["total"] = _since(started)
        return result

    def _inside_warning(
        self,
        found: Symmetries,
        merged: IntArray,
        vertices: FloatArray,
        faces: IntArray,
        resolution: float,
        max_error: float,
        choice: LevelChoice,
        sources: Sources,
    ) -> tuple[str, ...]:
        """What to say about bodies inside others: whether the outside alone has more than the whole."""
        hidden, bodies = inner_faces(vertices, faces, merged)
        if not bodies:
            return ()
        outside = np.ascontiguousarray(faces[~hidden])
        if not fits_better(found, vertices, outside, max_error):
            return inside_warning(bodies, found, found)
        frame = unit_frame(vertices, outside)
        own = replace(choice, tolerance=None if choice.tolerance is None else choice.tolerance / frame.scale)
        try:
            alone, _ = self._full(
                frame.to_unit(vertices), outside, resolution / frame.scale, max_error, own, sources, timings={}
            )
        except TooComplexError:
            alone = found
        return inside_warning(bodies, found, alone)

    def _paper(self, vertices: FloatArray, faces: IntArray, max_error: float, timings: dict[str, float]) -> Symmetries:
        proposals = self.propose(vertices, faces, timings)
        mark = time.perf_counter()
        surface = SurfaceIndex(vertices, faces)
        samples, _ = sample_surface(vertices, faces, DEFAULT.report_samples, seed=0)
        found = validate_proposals(proposals, surface, samples, max_error)
        timings["refine"] = 0.0
        timings["validate"] = _since(mark)
        return found

    def _full(
        self,
        vertices: FloatArray,
        faces: IntArray,
        resolution: float,
        max_error: float,
        choice: LevelChoice,
        sources: Sources,
        timings: dict[str, float],
    ) -> tuple[Symmetries, "_Places"]:
        """What full mode answers, and what it has seen of the mesh."""
        context, network, found = self.search(vertices, faces, max_error, sources=sources, timings=timings)
        mark, asked = time.perf_counter(), timings["infer"]
        cut_short = context.is_spent
        result = answer(
            context,
            found,
            SurfaceSamples.drawn(context.sampler, DEFAULT.report_samples, seed=0),
            ExactnessTest(context.surface, context.meter.facets, resolution),
            choice,
            network,
        )
        result.cut_short = cut_short
        timings["infer"] = asked if network is None else network.spent_ms
        timings["validate"] = _since(mark) - (timings["infer"] - asked)
        return result, _Places(context.meter.facets.first, context.meter.facets.edges.all_paired)

    def search(
        self,
        vertices: FloatArray,
        faces: IntArray,
        max_error: float = MAX_ERROR,
        *,
        sources: Sources = ALL_SOURCES,
        timings: dict[str, float] | None = None,
    ) -> tuple[SearchContext, NetworkOutput | None, Found]:
        """All that full mode finds, before one level is chosen and judged: for studies of the judgement.

        Args:
            vertices: ``(v, 3)`` float64, unit frame.
            faces: ``(f, 3)`` int32.
            max_error: largest accepted symmetry error.
            sources: where candidates come from.
            timings: if given, ``voxelize``, ``infer`` and ``refine`` are filled in, in milliseconds.

        Returns:
            what it was searched with, what the network says if it may be asked, and the levels and candidates found.
        """
        spent: dict[str, float] = {}
        mark = time.perf_counter()
        principal = principal_frame(vertices, faces)
        turn = principal if self._checkpoint.input.frame == "inertia" else np.eye(3)
        occupied = rotated_voxels(self._checkpoint, vertices, faces, turn)
        spent["voxelize"] = _since(mark)
        mark = time.perf_counter()
        network = NetworkOutput(self._checkpoint, vertices, faces, occupied, turn) if sources.network else None
        surface = SurfaceIndex(vertices, faces)
        sampler = SurfaceSampler(vertices, faces)
        samples = SurfaceSamples.drawn(sampler, DEFAULT.refine_samples, seed=1)
        sides = directions()[::DIRECTION_STRIDE] @ principal
        anchors = extreme_vertices(vertices, faces, np.concatenate([sides, -sides]))
        judging = SurfaceSamples.drawn(sampler, DEFAULT.judge_samples, seed=2)
        meter = DeviationMeter(surface, vertices, faces, near=DEFAULT.near)
        context = SearchContext(
            meter, sampler, samples, anchors, judging, DistanceGrid(occupied), turn, principal, max_error
        )
        found = find_symmetries(context, network, sources)
        if network is not None and not all(is_certain(context, level) for level in found.levels):
            _ = network.first  # it will be evidence: asked here, where less memory is held than while judging
        spent["infer"] = 0.0 if network is None else network.spent_ms
        spent["refine"] = _since(mark) - spent["infer"]
        if timings is not None:
            timings.update(spent)
        return context, network, found

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
    if "torch" in sys.modules:  # needed for networks with other layers alone
        sys.modules["torch"].set_num_threads(1)


def _resolution(mesh: Mesh, vertices: FloatArray, vertices_unit: FloatArray) -> float:
    """What the coordinates of a mesh may be off by, from its vertices, one at each place ``(v, 3)``.

    Those that no face uses do not count if any of them is farther out than the surface.
    """
    if max(float(vertices_unit.max()), -float(vertices_unit.min())) <= _OUTERMOST:
        return resolution_of(vertices, drawn_from=mesh.vertices)
    return resolution_of(mesh.vertices[np.unique(mesh.faces)])


def _since(mark: float) -> float:
    return (time.perf_counter() - mark) * 1e3
