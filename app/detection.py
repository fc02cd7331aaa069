"""From the bytes of a file to the answer: what runs on a worker, and what the command line runs too."""

import time
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from app import schemas
from app.schemas import Include, LevelName, Mode
from model.formats.reading import MOST_NODES, MOST_UNPACKED_BYTES, Resources, no_resources, read_mesh

if TYPE_CHECKING:
    from model.detection import Axis, Detection, Level, Plane, Rejected
    from model.meshes.mesh import Mesh
    from model.types import FloatArray


class SymmetryDetector(Protocol):
    """What this package needs of ``model.detector.Detector``."""

    @property
    def name(self) -> str:
        """Name of the model."""
        ...

    @property
    def version(self) -> str:
        """Version of the weights."""
        ...

    @property
    def sha256(self) -> str:
        """Digest of the weights file."""
        ...

    @property
    def metadata(self) -> Mapping[str, Any]:
        """What is stored with the weights."""
        ...

    def warm_up(self) -> None:
        """Do now what would make the first detection slow."""
        ...

    def detect(
        self,
        mesh: "Mesh",
        *,
        mode: Mode = ...,
        max_error: float = ...,
        level: LevelName = ...,
        tolerance: float | None = ...,
    ) -> "Detection":
        """Find the symmetries of ``mesh``."""
        ...


def load_detector(weights: str) -> SymmetryDetector:
    """The real detector with ``weights``.

    Raises:
        model.errors.CheckpointError: the weights are missing, damaged or do not fit.
    """
    from model.detector import Detector  # here: torch and numba take seconds to import

    return Detector.load(weights)


@dataclass(frozen=True, slots=True)
class Options:
    """What to look for and what to return."""

    mode: Mode = "full"
    max_error: float = 4e-4
    include: Collection[Include] = ()
    level: LevelName = "auto"
    tolerance: float | None = None


@dataclass(frozen=True, slots=True)
class MeshLimits:
    """Largest file accepted, by what is in it; ``None`` is no limit."""

    vertices: int | None = None
    faces: int | None = None
    nodes: int = MOST_NODES
    unpacked_bytes: int = MOST_UNPACKED_BYTES


def parse_and_detect(
    detector: SymmetryDetector,
    data: bytes,
    filename: str,
    options: Options,
    limits: MeshLimits,
    on_parsed: Callable[[], None] = lambda: None,
) -> schemas.DetectResponse:
    """The answer for a mesh file; ``on_parsed`` is called between reading the file and computing.

    Raises:
        model.errors.MeshError: the file cannot be read or the mesh cannot be used.
    """
    return detect_file(detector, data, filename, options, limits, on_parsed)[0]


def detect_file(
    detector: SymmetryDetector,
    data: bytes,
    filename: str,
    options: Options,
    limits: MeshLimits,
    on_parsed: Callable[[], None] = lambda: None,
    resources: Resources = no_resources,
    *,
    looks: bool = False,
) -> "tuple[schemas.DetectResponse, Mesh]":
    """What `parse_and_detect` answers, and the mesh it is about; ``resources`` are files that the mesh may refer to.

    With ``looks`` it has the colours of its materials and its pictures, to be written again.

    Raises:
        model.errors.MeshError: the file cannot be read or the mesh cannot be used.
    """
    started = time.perf_counter()
    mesh = read_within(limits, data, filename, resources, looks=looks)
    parsed = time.perf_counter()
    on_parsed()
    detection = detector.detect(
        mesh, mode=options.mode, max_error=options.max_error, level=options.level, tolerance=options.tolerance
    )
    return to_response(detection, detector, filename, options.include, started, parsed), mesh


def read_within(
    limits: MeshLimits, data: bytes, filename: str, resources: Resources = no_resources, *, looks: bool = False
) -> "Mesh":
    """The mesh of a file that keeps the limits; with ``looks`` to be written again.

    Raises:
        model.errors.MeshError: it does not, or cannot be read.
    """
    return read_mesh(
        data,
        filename,
        max_vertices=limits.vertices,
        max_faces=limits.faces,
        max_nodes=limits.nodes,
        max_unpacked_bytes=limits.unpacked_bytes,
        resources=resources,
        looks=looks,
    )


def to_response(
    detection: "Detection",
    detector: SymmetryDetector,
    filename: str,
    include: Collection[Include],
    started: float,
    parsed: float,
) -> schemas.DetectResponse:
    """A detection as the response schema; ``started`` and ``parsed`` are readings of ``time.perf_counter``.

    Raises:
        pydantic.ValidationError: the detection breaks the contract (with a NaN, say): a defect.
    """
    mesh = detection.mesh
    return schemas.DetectResponse(
        planes=[_plane(plane) for plane in detection.planes],
        axes=[_axis(axis) for axis in detection.axes],
        point_group=detection.point_group,
        frame=schemas.Frame(
            coordinates="input",
            units=mesh.units,
            center=numbers(detection.center),
            scale=float(detection.scale),
        ),
        mesh=mesh_info(mesh, filename, detection.watertight),
        model=schemas.ModelInfo(name=detector.name, version=detector.version, sha256=detector.sha256),
        warnings=list(detection.warnings),
        levels=[_level(level) for level in detection.levels],
        similar=[_similar(candidate) for candidate in detection.similar],
        rejected=[_rejected(candidate) for candidate in detection.rejected] if "rejected" in include else [],
        bop=schemas.Bop.model_validate(detection.bop()) if "bop" in include else None,
        timings_ms=timings(detection.timings_ms, started, parsed),  # last: the total covers all of the above
    )


def mesh_info(mesh: "Mesh", filename: str, watertight: bool | None = None) -> schemas.MeshInfo:
    """What an answer tells about a mesh; whether it is ``watertight`` takes time to see, if that is not known."""
    return schemas.MeshInfo(
        filename=filename,
        format=mesh.source_format,
        vertices=len(mesh.vertices),
        faces=len(mesh.faces),
        bounds=_rows(mesh.bounds),
        watertight=mesh.watertight if watertight is None else watertight,
        kind=mesh.kind,
    )


def timings(steps: Mapping[str, float], started: float, parsed: float) -> schemas.Timings:
    """The steps of a detection, with readings of ``time.perf_counter`` before and after the file was read."""
    return schemas.Timings(
        parse=(parsed - started) * 1e3,
        voxelize=steps.get("voxelize", 0.0),
        infer=steps.get("infer", 0.0),
        refine=steps.get("refine", 0.0),
        validate=steps.get("validate", 0.0),
        total=(time.perf_counter() - started) * 1e3,
    )


def numbers(values: "FloatArray | Iterable[float]") -> list[float]:
    """Numbers as JSON has them."""
    # + 0.0 turns -0.0 into 0.0 and changes nothing else
    return [float(value) + 0.0 for value in values]


def _rows(matrix: "FloatArray | Iterable[Iterable[float]]") -> list[list[float]]:
    return [numbers(row) for row in matrix]


def _plane(plane: "Plane") -> schemas.Plane:
    return schemas.Plane(
        normal=numbers(plane.normal),
        offset=float(plane.offset) + 0.0,
        point=numbers(plane.point),
        matrix=_rows(plane.matrix),
        symmetry_error=float(plane.symmetry_error),
        rms_distance=float(plane.rms_distance),
        max_distance=float(plane.max_distance),
        coverage=float(plane.coverage),
        confidence=plane.confidence,
        evidence=plane.evidence,
        exact=bool(plane.exact),
        continuous=bool(plane.continuous),
    )


def _axis(axis: "Axis") -> schemas.Axis:
    return schemas.Axis(
        direction=numbers(axis.direction),
        point=numbers(axis.point),
        order=axis.order,
        continuous=bool(axis.continuous),
        matrix=None if axis.matrix is None else _rows(axis.matrix),
        symmetry_error=float(axis.symmetry_error),
        rms_distance=float(axis.rms_distance),
        max_distance=float(axis.max_distance),
        coverage=float(axis.coverage),
        confidence=axis.confidence,
        evidence=axis.evidence,
        exact=bool(axis.exact),
    )


def _level(level: "Level") -> schemas.Level:
    return schemas.Level(
        point_group=level.point_group,
        planes=level.planes,
        axes=level.axes,
        rms_distance=level.rms_distance,
        next_rms_distance=level.next_rms_distance,
        missing=level.missing,
        exact=level.exact,
        chosen=level.chosen,
        confidence=level.confidence,
        evidence=level.evidence,
        breaks=[
            schemas.Patch(
                center=numbers(patch.center), size=patch.size, max_distance=patch.max_distance, present=patch.present
            )
            for patch in level.breaks
        ],
    )


def _similar(candidate: "Rejected") -> schemas.SimilarPlane | schemas.SimilarAxis:
    kind = schemas.SimilarPlane if candidate.kind == "plane" else schemas.SimilarAxis
    return kind.model_validate(_members(candidate))


def _rejected(candidate: "Rejected") -> schemas.RejectedPlane | schemas.RejectedAxis:
    kind = schemas.RejectedPlane if candidate.kind == "plane" else schemas.RejectedAxis
    return kind.model_validate(_members(candidate))


def _members(candidate: "Rejected") -> dict[str, Any]:
    return {
        name: numbers(value) if name in {"normal", "direction", "point"} else value
        for name in ("kind", "normal", "offset", "direction", "point", "symmetry_error", "reason")
        if (value := getattr(candidate, name)) is not None
    }
