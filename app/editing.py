"""Half a mesh, and a copy of it laid along the axes: what runs on a worker, and what the command line runs too."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from app import schemas
from app.detection import MeshLimits, SymmetryDetector, mesh_info, read_within, timings
from model.completion import mirroring
from model.completion.alignment import alignment
from model.detection import Detection, prediction_warning
from model.errors import NoPlaneError
from model.formats.reading import Resources, no_resources
from model.meshes.clipping import remove_unreferenced_vertices
from model.meshes.colors import with_looks_of
from model.meshes.mesh import Mesh
from model.types import FloatArray


@dataclass(frozen=True, slots=True)
class HalveOptions:
    """Where to cut (unit normal and offset; None: the best plane within a limit), and which side stays."""

    plane: list[float] | None = None
    positive: bool = True
    max_error: float = 4e-4


@dataclass(frozen=True, slots=True)
class AlignOptions:
    """The largest error of a symmetry that a mesh is laid by."""

    max_error: float = 4e-4


def edit_file(
    detector: SymmetryDetector,
    data: bytes,
    filename: str,
    options: HalveOptions | AlignOptions,
    limits: MeshLimits,
    on_parsed: Callable[[], None] = lambda: None,
    resources: Resources = no_resources,
) -> "tuple[schemas.HalvedMesh | schemas.AlignedMesh, Mesh]":
    """What was done with the mesh of a file, and the mesh that came of it.

    Raises:
        NoPlaneError: no plane was given and the mesh has none within the limit, or nothing to be laid by.
        model.errors.MeshError: the file cannot be read or the mesh cannot be used.
    """
    started = time.perf_counter()
    mesh = read_within(limits, data, filename, resources, looks=True)
    parsed = time.perf_counter()
    on_parsed()
    if isinstance(options, HalveOptions):
        return halve_mesh(detector, mesh, filename, options, started, parsed)
    return align_mesh(detector, mesh, filename, options, started, parsed)


def halve_mesh(
    detector: SymmetryDetector, mesh: Mesh, filename: str, options: HalveOptions, started: float, parsed: float
) -> "tuple[schemas.HalvedMesh, Mesh]":
    """What `edit_file` does, for a mesh that was read between two readings of ``time.perf_counter``.

    Raises:
        NoPlaneError, model.errors.MeshError: as there.
    """
    steps: dict[str, float] = {}
    warnings = mesh.warnings
    if options.plane is None:
        detection = detector.detect(mesh, mode="full", max_error=options.max_error)
        plane, steps = best_plane(detection, options.max_error), detection.timings_ms
        warnings = (*warnings, *prediction_warning(detection.planes))
    else:
        plane = np.array(options.plane)
    result = half_of(mesh, plane, positive=options.positive)
    answer = schemas.HalvedMesh(
        half=schemas.Half(
            normal=[float(value) + 0.0 for value in plane[:3]],
            offset=float(plane[3]) + 0.0,
            detected=options.plane is None,
            side="positive" if options.positive else "negative",
            faces=len(result.faces),
            warnings=list(warnings),
        ),
        mesh=mesh_info(result, filename),
        timings_ms=timings(steps, started, parsed),
    )
    return answer, result


def align_mesh(
    detector: SymmetryDetector, mesh: Mesh, filename: str, options: AlignOptions, started: float, parsed: float
) -> "tuple[schemas.AlignedMesh, Mesh]":
    """What `edit_file` does, for a mesh that was read between two readings of ``time.perf_counter``.

    Raises:
        NoPlaneError: it has neither plane nor axis within the limit.
    """
    detection = detector.detect(mesh, mode="full", max_error=options.max_error)
    matrix = alignment(detection)
    vertices, faces, used = remove_unreferenced_vertices(mesh.vertices, mesh.faces)
    result = Mesh.checked(
        vertices @ matrix[:3, :3].T + matrix[:3, 3],
        faces,
        source_format=mesh.source_format,
        units=mesh.units,
        colors=None if mesh.colors is None else mesh.colors[used],
        texture=None if mesh.texture is None else mesh.texture.part(vertices=used),
    )
    answer = schemas.AlignedMesh(
        alignment=schemas.Alignment(
            matrix=[[float(value) + 0.0 for value in row] for row in matrix],
            point_group=detection.point_group,
            warnings=[*mesh.warnings, *prediction_warning(detection.planes)],
        ),
        mesh=mesh_info(result, filename),
        timings_ms=timings(detection.timings_ms, started, parsed),
    )
    return answer, result


def half_of(mesh: Mesh, plane: FloatArray, *, positive: bool = True) -> Mesh:
    """One side of a plane ``(4,)``, cut exactly there and open, with its colours.

    Raises:
        model.errors.DegenerateMeshError: nothing of the mesh is on that side.
    """
    vertices, faces = mirroring.halve(mesh, plane, positive=positive)
    return with_looks_of(mesh, vertices, faces, np.zeros(len(faces), dtype=np.bool_), plane)


def best_plane(detection: Detection, max_error: float) -> FloatArray:
    """The first plane of an answer, ``(4,)``.

    Raises:
        NoPlaneError: there is none; it says which threshold would do.
    """
    if detection.planes:
        best = detection.planes[0]
        return np.append(best.normal, best.offset)
    errors = [item.symmetry_error for item in detection.rejected if item.kind == "plane"]
    nearest = f"; the best has {min(errors):.2g}" if errors else ""
    raise NoPlaneError(
        f"No mirror plane has an error of at most {max_error:g}{nearest}. Give a larger max_error, or a plane."
    )
