"""Half a mesh, a sector of it, a copy of it laid along the axes: on a worker, and for the command line too."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from app import edit_schemas
from app.detection import MeshLimits, SymmetryDetector, mesh_info, numbers, read_within, timings
from model.completion.alignment import alignment
from model.completion.halving import halve
from model.completion.sector import cut_sector
from model.detection import Axis, Detection, prediction_warning
from model.errors import NoAxisError, NoPlaneError
from model.formats.reading import Resources, no_resources
from model.meshes.clipping import remove_unreferenced_vertices
from model.meshes.colors import with_looks_of
from model.meshes.mesh import Mesh
from model.types import FloatArray, IntArray

_LEFT_OPEN = (
    "The cut is left open: the outline of a body in it is not closed or crosses itself, so that nobody knows what is "
    "inside."
)


@dataclass(frozen=True, slots=True)
class HalveOptions:
    """Where to cut (unit normal and offset; None: the best plane within a limit), and which side stays."""

    plane: list[float] | None = None
    positive: bool = True
    max_error: float = 4e-4
    capped: bool = False


@dataclass(frozen=True, slots=True)
class SectorOptions:
    """Which axis (unit direction and point; None: the best within a limit), how many sectors, where the first cut goes.

    An axis that is given needs an order too.
    """

    line: list[float] | None = None
    order: int | None = None
    start: list[float] | None = None
    max_error: float = 4e-4
    capped: bool = True


@dataclass(frozen=True, slots=True)
class AlignOptions:
    """The largest error of a symmetry that a mesh is laid by."""

    max_error: float = 4e-4


EditOptions: TypeAlias = HalveOptions | SectorOptions | AlignOptions


def edit_file(
    detector: SymmetryDetector,
    data: bytes,
    filename: str,
    options: EditOptions,
    limits: MeshLimits,
    on_parsed: Callable[[], None] = lambda: None,
    resources: Resources = no_resources,
) -> "tuple[edit_schemas.HalvedMesh | edit_schemas.SectorMesh | edit_schemas.AlignedMesh, Mesh]":
    """What was done with the mesh of a file, and the mesh that came of it.

    Raises:
        NoPlaneError: no plane was given and the mesh has none within the limit, or nothing to be laid by.
        NoAxisError: no axis was given and the mesh has none of that order within the limit.
        model.errors.MeshError: the file cannot be read or the mesh cannot be used.
    """
    started = time.perf_counter()
    mesh = read_within(limits, data, filename, resources, looks=True)
    parsed = time.perf_counter()
    on_parsed()
    if isinstance(options, HalveOptions):
        return halve_mesh(detector, mesh, filename, options, started, parsed)
    if isinstance(options, SectorOptions):
        return sector_mesh(detector, mesh, filename, options, started, parsed)
    return align_mesh(detector, mesh, filename, options, started, parsed)


def halve_mesh(
    detector: SymmetryDetector, mesh: Mesh, filename: str, options: HalveOptions, started: float, parsed: float
) -> "tuple[edit_schemas.HalvedMesh, Mesh]":
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
    result, capped, overlapping = half_of(mesh, plane, positive=options.positive, capped=options.capped)
    answer = edit_schemas.HalvedMesh(
        half=edit_schemas.Half(
            normal=numbers(plane[:3]),
            offset=float(plane[3]) + 0.0,
            detected=options.plane is None,
            side="positive" if options.positive else "negative",
            capped=capped,
            points=_datum_points(mesh, plane),
            faces=len(result.faces),
            warnings=[*warnings, *_about_lids(options.capped, capped, overlapping)],
        ),
        mesh=mesh_info(result, filename),
        timings_ms=timings(steps, started, parsed),
    )
    return answer, result


def half_of(mesh: Mesh, plane: FloatArray, *, positive: bool = True, capped: bool = False) -> tuple[Mesh, bool, int]:
    """One side of a plane ``(4,)`` with its looks, whether the cut is closed, and how many bodies overlap in it.

    Raises:
        model.errors.DegenerateMeshError: nothing of the mesh is on that side.
    """
    half = halve(mesh, plane, positive=positive, capped=capped)
    return _dressed(mesh, half.vertices, half.faces), half.capped, half.overlapping


def sector_mesh(
    detector: SymmetryDetector, mesh: Mesh, filename: str, options: SectorOptions, started: float, parsed: float
) -> "tuple[edit_schemas.SectorMesh, Mesh]":
    """What `edit_file` does, for a mesh that was read between two readings of ``time.perf_counter``.

    Raises:
        NoAxisError, model.errors.MeshError: as there.
    """
    steps: dict[str, float] = {}
    mirrors: list[FloatArray] = []
    deviation = 0.0
    if options.line is None:
        detection = detector.detect(mesh, mode="full", max_error=options.max_error)
        steps = detection.timings_ms
        axis, order = best_axis(detection, options.order, options.max_error)
        direction, point, deviation = axis.direction, axis.point, float(axis.max_distance)
        mirrors = [plane.normal for plane in detection.planes if abs(float(plane.normal @ direction)) < 1e-6]
    else:
        direction, point = np.array(options.line[:3]), np.array(options.line[3:])
        order = options.order or 2
    start = None if options.start is None else np.array(options.start)
    sector = cut_sector(
        mesh, direction, point, order, start=start, mirrors=mirrors, capped=options.capped, deviation=deviation
    )
    result = _dressed(mesh, sector.vertices, sector.faces)
    dependent, independent = (
        edit_schemas.CutPlane(normal=numbers(plane[:3]), offset=float(plane[3]) + 0.0) for plane in sector.planes
    )
    answer = edit_schemas.SectorMesh(
        sector=edit_schemas.Sector(
            order=order,
            angle=360.0 / order,
            direction=numbers(direction),
            ends=[numbers(end) for end in sector.ends],
            dependent=dependent,
            independent=independent,
            detected=options.line is None,
            max_distance=deviation if options.line is None else None,
            capped=sector.capped,
            faces=len(result.faces),
            warnings=[*mesh.warnings, *_about_lids(options.capped, sector.capped, sector.overlapping)],
        ),
        mesh=mesh_info(result, filename),
        timings_ms=timings(steps, started, parsed),
    )
    return answer, result


def _about_lids(wanted: bool, capped: bool, overlapping: int) -> list[str]:
    if wanted and not capped:
        return [_LEFT_OPEN]
    if not overlapping:
        return []
    return [
        f"{overlapping} bodies overlap where the mesh is cut. Each was closed alone, so that they overlap in the "
        "result too; unite them before it is meshed for a simulation."
    ]


def _datum_points(mesh: Mesh, plane: FloatArray) -> list[list[float]]:
    """Three points of a plane, beside each other in the middle of the mesh, as far apart as it is large."""
    normal, (low, high) = plane[:3], mesh.bounds
    middle = (low + high) / 2.0
    foot = middle - (normal @ middle + plane[3]) * normal
    across = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    across *= float(np.linalg.norm(high - low)) / 2.0 / float(np.linalg.norm(across))
    return [numbers(point) for point in (foot, foot + across, foot + np.cross(normal, across))]


def _dressed(mesh: Mesh, vertices: FloatArray, faces: IntArray) -> Mesh:
    """A part of a mesh, with its colours and pictures."""
    return with_looks_of(mesh, vertices, faces, np.zeros(len(faces), dtype=np.bool_), np.zeros(4))


def align_mesh(
    detector: SymmetryDetector, mesh: Mesh, filename: str, options: AlignOptions, started: float, parsed: float
) -> "tuple[edit_schemas.AlignedMesh, Mesh]":
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
    answer = edit_schemas.AlignedMesh(
        alignment=edit_schemas.Alignment(
            matrix=[numbers(row) for row in matrix],
            point_group=detection.point_group,
            warnings=[*mesh.warnings, *prediction_warning(detection.planes)],
        ),
        mesh=mesh_info(result, filename),
        timings_ms=timings(detection.timings_ms, started, parsed),
    )
    return answer, result


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


def best_axis(detection: Detection, order: int | None, max_error: float) -> tuple[Axis, int]:
    """The axis of an answer to cut sectors about, the one of the highest order that will do, and how many there are.

    Raises:
        NoAxisError: there is none; it says which orders there are.
    """
    finite = [axis for axis in detection.axes if axis.order is not None]
    continuous = [axis for axis in detection.axes if axis.order is None]
    if order is None:
        if finite and not continuous:
            best = max(finite, key=lambda axis: axis.order or 0)
            return best, best.order or 2
        if continuous:
            raise NoAxisError(
                "Every angle about the axis is a symmetry, so that there is no order to cut by. Give an order (12 "
                "makes sectors of 30 degrees), or model the shape as axisymmetric."
            )
        raise NoAxisError(
            f"No rotation axis has an error of at most {max_error:g}. "
            "Give a larger max_error, or axis, point and order."
        )
    fitting = continuous or [axis for axis in finite if (axis.order or 0) % order == 0]
    if not fitting:
        orders = ", ".join(str(value) for value in sorted({axis.order for axis in finite if axis.order}, reverse=True))
        there = f"the axes have the orders {orders}" if orders else f"there is none within {max_error:g}"
        raise NoAxisError(
            f"No rotation axis has an order that {order} divides: {there}. Give another order, or an axis and a point."
        )
    return max(fitting, key=lambda axis: axis.order or 0), order
