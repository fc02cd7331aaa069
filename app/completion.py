"""From the bytes of a file to the completed mesh: what runs on a worker, and what the command line runs too."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from app import edit_schemas
from app.detection import MeshLimits, SymmetryDetector, mesh_info, read_within, timings
from app.editing import best_plane
from model.completion.mirroring import Completed, complete
from model.detection import prediction_warning
from model.formats.reading import Resources, no_resources
from model.meshes.colors import with_looks_of
from model.meshes.mesh import Mesh

if TYPE_CHECKING:
    from model.types import FloatArray


@dataclass(frozen=True, slots=True)
class CompleteOptions:
    """How to complete: at which plane (unit normal and offset; None: the best there is), and with what limit on it."""

    plane: list[float] | None = None
    symmetrize: bool = False
    max_error: float = 4e-4


def complete_file(
    detector: SymmetryDetector,
    data: bytes,
    filename: str,
    options: CompleteOptions,
    limits: MeshLimits,
    on_parsed: Callable[[], None] = lambda: None,
    resources: Resources = no_resources,
) -> "tuple[edit_schemas.CompletedMesh, Mesh]":
    """The mesh of a file completed by its mirror image: what was done, and the completed mesh.

    Raises:
        NoPlaneError: none was given, and the mesh has none within ``options.max_error``.
        model.errors.MeshError: the file cannot be read or the mesh cannot be used.
    """
    started = time.perf_counter()
    mesh = read_within(limits, data, filename, resources, looks=True)
    parsed = time.perf_counter()
    on_parsed()
    return complete_mesh(detector, mesh, filename, options, started, parsed)


def complete_mesh(
    detector: SymmetryDetector, mesh: Mesh, filename: str, options: CompleteOptions, started: float, parsed: float
) -> "tuple[edit_schemas.CompletedMesh, Mesh]":
    """What `complete_file` answers, for a mesh that was read between two readings of ``time.perf_counter``.

    Raises:
        NoPlaneError: none was given, and the mesh has none within ``options.max_error``.
    """
    steps: dict[str, float] = {}
    warnings = mesh.warnings
    if options.plane is None:
        detection = detector.detect(mesh, mode="full", max_error=options.max_error)
        plane, steps = best_plane(detection, options.max_error), detection.timings_ms
        warnings = (*warnings, *prediction_warning(detection.planes))
    else:
        plane = np.array(options.plane)
    began = time.perf_counter()
    done = complete(mesh, plane, symmetrize=options.symmetrize)
    mirrored = np.arange(len(done.faces)) >= done.faces_kept
    result = with_looks_of(mesh, done.vertices, done.faces, mirrored, plane)
    answer = edit_schemas.CompletedMesh(
        completion=_completion(done, plane, options, warnings),
        mesh=mesh_info(result, filename),
        complete_ms=(time.perf_counter() - began) * 1e3,
        timings_ms=timings(steps, started, parsed),
    )
    return answer, result


def _completion(
    done: Completed, plane: "FloatArray", options: CompleteOptions, warnings: tuple[str, ...]
) -> edit_schemas.Completion:
    return edit_schemas.Completion(
        plane=edit_schemas.MirrorPlane(
            normal=[float(value) + 0.0 for value in plane[:3]],
            offset=float(plane[3]) + 0.0,
            detected=options.plane is None,
            symmetry_error=done.symmetry_error,
        ),
        vertices_kept=done.vertices_kept,
        faces_kept=done.faces_kept,
        vertices_added=len(done.vertices) - done.vertices_kept,
        faces_added=len(done.faces) - done.faces_kept,
        area_added=done.area_added,
        tolerance=done.tolerance,
        seam_distance=done.seam_distance,
        symmetrized=options.symmetrize,
        warnings=list(warnings),
    )
