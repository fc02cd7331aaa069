"""The JSON this service answers with. Every coordinate is in the input frame, every number finite."""

from collections.abc import Collection
from typing import Annotated, Any, Literal, TypeAlias

from pydantic import BaseModel, ConfigDict, Field

from model.summary import SymmetrySummary

Mode: TypeAlias = Literal["full", "paper"]
LevelName: TypeAlias = Literal["auto", "exact"]
Include: TypeAlias = Literal["rejected", "bop"]
Evidence: TypeAlias = Literal["measured", "predicted"]
Vector: TypeAlias = Annotated[list[float], Field(min_length=3, max_length=3)]
Row: TypeAlias = Annotated[list[float], Field(min_length=4, max_length=4)]
Matrix: TypeAlias = Annotated[list[Row], Field(min_length=4, max_length=4)]
FlatMatrix: TypeAlias = Annotated[list[float], Field(min_length=16, max_length=16)]


KEY_HEADER = "X-API-Key"
"""The header a key is sent in."""


class Schema(BaseModel):
    """Base of all schemas: immutable, no unknown members, no NaN, no infinity."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


_CONFIDENCE = "Probability that it is a symmetry of the intact shape; null in paper mode."
_EVIDENCE = (
    "`measured` on the surface, or `predicted` by the network where too little of the surface is there to tell; what "
    "is predicted is never exact."
)


class Plane(Schema):
    """A mirror plane: the points x with normal·x + offset = 0."""

    normal: Vector = Field(description="Unit normal; its first non-zero component is positive.")
    offset: float = Field(description="Input units.")
    point: Vector = Field(description="The mesh's centre projected on the plane.")
    matrix: Matrix = Field(description="The reflection, rows of a 4x4 matrix for column vectors.")
    symmetry_error: float = Field(
        ge=0,
        description="Mean squared distance of the reflected surface to the surface, unit frame; "
        "without what is reflected beyond an open boundary.",
    )
    rms_distance: float = Field(ge=0, description="Root of the mean squared distance, input units.")
    max_distance: float = Field(ge=0, description="Largest deviation seen, features included, input units.")
    coverage: float = Field(ge=0, le=1, description="Share of the surface whose counterpart is there and fits.")
    confidence: float | None = Field(ge=0, le=1, description=_CONFIDENCE)
    evidence: Evidence = Field(default="measured", description=_EVIDENCE)
    exact: bool = Field(description="Symmetric everywhere, up to the resolution and the facets of the file.")
    continuous: bool = Field(description="Belongs to a continuous axis, every plane through which is a symmetry.")


class Axis(Schema):
    """A rotation axis."""

    direction: Vector = Field(description="Unit direction.")
    point: Vector = Field(description="The mesh's centre projected on the axis.")
    order: int | None = Field(ge=2, description="Largest n with rotation by 2π/n a symmetry; null if continuous.")
    continuous: bool = Field(description="Rotation by every angle is a symmetry.")
    matrix: Matrix | None = Field(description="Rotation by 2π/order, rows of a 4x4 matrix; null if continuous.")
    symmetry_error: float = Field(
        ge=0,
        description="Mean squared distance of the rotated surface to the surface, unit frame; "
        "without what is rotated beyond an open boundary.",
    )
    rms_distance: float = Field(ge=0, description="Root of the mean squared distance, input units.")
    max_distance: float = Field(ge=0, description="Largest deviation seen, features included, input units.")
    coverage: float = Field(ge=0, le=1, description="Share of the surface whose counterpart is there and fits.")
    confidence: float | None = Field(ge=0, le=1, description=_CONFIDENCE)
    evidence: Evidence = Field(default="measured", description=_EVIDENCE)
    exact: bool = Field(description="Symmetric everywhere, up to the resolution and the facets of the file.")


class Frame(Schema):
    """How the answer's coordinates relate to the unit frame: unit = (input - center) / scale."""

    coordinates: Literal["input"]
    units: str | None = Field(description="Unit of length if the file states one.")
    center: Vector = Field(description="Area-weighted centroid of the surface.")
    scale: float = Field(gt=0, description="Twice the largest distance of a surface point from the centre.")


class MeshInfo(Schema):
    """The mesh as it was read."""

    filename: str = Field(description="Base name of the uploaded file.")
    format: str | None = Field(description="Format the file was read as.")
    vertices: int = Field(ge=0)
    faces: int = Field(ge=0)
    bounds: Annotated[list[Vector], Field(min_length=2, max_length=2)] = Field(
        description="Smallest and largest corner."
    )
    watertight: bool = Field(description="Every edge belongs to exactly two faces, identical vertices merged.")
    kind: Literal["mesh", "points"] = Field(
        default="mesh",
        description="Of a point cloud the vertices are the points that were used, the faces triangles between them.",
    )


class ModelInfo(Schema):
    """The weights that answered."""

    name: str
    version: str
    sha256: str = Field(description="Digest of the weights file.")


class Timings(Schema):
    """Milliseconds on the worker, without upload and waiting; the total is a little over the sum of steps."""

    parse: float = Field(ge=0)
    voxelize: float = Field(ge=0)
    infer: float = Field(ge=0)
    refine: float = Field(ge=0)
    validate_: float = Field(ge=0, alias="validate")
    total: float = Field(ge=0)


Reason: TypeAlias = Literal["not_symmetric", "duplicate", "not_continuous"]


class RejectedPlane(Schema):
    """A proposed plane that is not in the answer, and why."""

    kind: Literal["plane"]
    normal: Vector
    offset: float
    symmetry_error: float = Field(ge=0)
    reason: Reason


class RejectedAxis(Schema):
    """A proposed axis that is not in the answer, and why."""

    kind: Literal["axis"]
    direction: Vector
    point: Vector
    symmetry_error: float = Field(ge=0)
    reason: Reason


Rejected: TypeAlias = Annotated[RejectedPlane | RejectedAxis, Field(discriminator="kind")]


class SimilarPlane(Schema):
    """A plane that holds within `max_error` but belongs to no group."""

    kind: Literal["plane"]
    normal: Vector
    offset: float
    symmetry_error: float = Field(ge=0)


class SimilarAxis(Schema):
    """A rotation axis that holds within `max_error` but belongs to no group."""

    kind: Literal["axis"]
    direction: Vector
    point: Vector
    symmetry_error: float = Field(ge=0)


Similar: TypeAlias = Annotated[SimilarPlane | SimilarAxis, Field(discriminator="kind")]


class Patch(Schema):
    """A part of the surface that breaks a symmetry, input coordinates."""

    center: Vector
    size: float = Field(ge=0, description="Diagonal of its box.")
    max_distance: float = Field(ge=0, description="Largest deviation there.")
    present: bool = Field(description="Something is there that has no counterpart; else something is missing there.")


class Level(Schema):
    """A symmetry group that holds at some tolerance. Planes and axes of the answer are those of the chosen level."""

    point_group: str = Field(description="Schoenflies symbol in ASCII.")
    planes: int = Field(ge=0)
    axes: int = Field(ge=0)
    rms_distance: float = Field(ge=0, description="The tolerance it needs: largest RMS deviation, input units.")
    next_rms_distance: float | None = Field(ge=0, description="What the next larger group needs; null for the last.")
    missing: float = Field(ge=0, le=1, description="Share of the surface whose counterpart is beyond a boundary.")
    exact: bool | None = Field(description="It holds everywhere, up to what the file promises; null if not tested.")
    chosen: bool
    confidence: float = Field(ge=0, le=1, description="Probability that it is a group of the intact shape.")
    evidence: Evidence = Field(default="measured", description=_EVIDENCE)
    breaks: list[Patch] = Field(description="Where the chosen level does not hold, the largest deviation first.")


class BopContinuous(Schema):
    """A continuous symmetry in the format of the BOP benchmark."""

    axis: Vector
    offset: Vector


class Bop(Schema):
    """The symmetries in the format of the BOP benchmark's ``models_info.json``, input units."""

    diameter: float = Field(ge=0, description="Largest distance of two vertices.")
    symmetries_discrete: list[FlatMatrix] = Field(description="4x4 matrices, row-major.")
    symmetries_continuous: list[BopContinuous]


class BopEntry(Schema):
    """An entry of a BOP data set's ``models_info.json``: box and symmetries of one model, input units."""

    diameter: float = Field(ge=0, description="Largest distance of two vertices.")
    min_x: float
    min_y: float
    min_z: float
    size_x: float
    size_y: float
    size_z: float
    symmetries_discrete: list[FlatMatrix] | None = Field(default=None, description="Left out if there are none.")
    symmetries_continuous: list[BopContinuous] | None = Field(default=None, description="Left out if there are none.")


class DetectResponse(SymmetrySummary, Schema):
    """One symmetry group: its planes and axes, exact ones first. An asymmetric mesh has none and the group C1."""

    planes: list[Plane]
    axes: list[Axis]
    point_group: str = Field(description="Schoenflies symbol in ASCII.")
    frame: Frame
    mesh: MeshInfo
    model: ModelInfo
    timings_ms: Timings
    warnings: list[str]
    levels: list[Level] = Field(
        default=[],
        description="All groups that hold, the finest first; last the answer if it is predicted. Full mode only.",
    )
    similar: list[Similar] = Field(default=[], description="What holds within `max_error` but belongs to no group.")
    rejected: list[Rejected] = Field(default=[], description="Only with `include=rejected`.")
    bop: Bop | None = Field(default=None, description="Only with `include=bop`.")


def to_json(response: DetectResponse, include: Collection[Include]) -> bytes:
    """The response as UTF-8 JSON, without the members that were not asked for; numbers keep all digits."""
    left_out = {"rejected", "bop"} - set(include)
    return response.model_dump_json(exclude=left_out, by_alias=True).encode()


class Health(Schema):
    """The service's state."""

    status: Literal["ready", "alive"]


class Limits(Schema):
    """What a request may be."""

    max_upload_bytes: int
    max_vertices: int
    max_faces: int
    max_nodes: int = Field(description="Nodes, objects and placements of a scene.")
    max_unpacked_bytes: int = Field(description="Bytes that a 3MF file may unpack to.")
    memory_bytes: int = Field(description="Memory that reading and computing may use.")
    upload_s: float = Field(description="Seconds an upload may take.")
    stall_s: float = Field(description="Seconds it may pause.")
    parse_s: float = Field(description="Seconds the reading of a file may take.")
    deadline_s: float = Field(description="Seconds a request may take in total.")
    max_answer_bytes: int = Field(description="Bytes of a mesh that is sent back.")
    formats: list[str]


class ModelCard(Schema):
    """The served weights: what they are, how they were trained, how well they do."""

    name: str
    version: str
    sha256: str
    service_version: str
    metadata: dict[str, Any] = Field(description="Architecture, recipe, data, metrics: as stored with the weights.")
    limits: Limits


class InvalidParameter(Schema):
    """One query parameter that was refused."""

    parameter: str
    message: str


class Problem(Schema):
    """An error (RFC 9457)."""

    type: str = Field(description="Stable identifier of the kind of error, a relative reference.")
    title: str
    status: int
    detail: str = Field(description="What is wrong and what to do about it.")
    request_id: str = Field(description="Also in the header X-Request-ID.")
    errors: list[InvalidParameter] = Field(default=[], description="Only for invalid parameters.")
