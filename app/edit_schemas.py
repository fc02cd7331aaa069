"""What is told about a mesh that was made of another: completed, halved, a sector, laid along the axes."""

from typing import Annotated, Literal

from pydantic import Field

from app.schemas import Matrix, MeshInfo, Schema, Timings, Vector

COMPLETION, HALF, SECTOR = "PRSNet-Completion", "PRSNet-Half", "PRSNet-Sector"
ALIGNMENT = "PRSNet-Alignment"
"""The headers that say what `/complete`, `/halve`, `/sector` and `/align` did."""

_CALCULIX = "Lines for an input file of CalculiX."
_FREECAD = "The same for FreeCAD's Python console."
_WARNINGS = "What was left out or guessed when the file was read, and whether the plane is predicted."


class MirrorPlane(Schema):
    """The plane a mesh was completed at: the points x with normal·x + offset = 0, input coordinates."""

    normal: Vector
    offset: float
    detected: bool = Field(description="Found here, not given with the request.")
    symmetry_error: float = Field(ge=0, description="Of the mesh as it came: the mean squared distance, unit frame.")


class Completion(Schema):
    """What `/complete` did, in the header `PRSNet-Completion`. Lengths in input units."""

    plane: MirrorPlane
    vertices_kept: int = Field(ge=0)
    faces_kept: int = Field(ge=0)
    vertices_added: int = Field(ge=0)
    faces_added: int = Field(ge=0)
    area_added: float = Field(ge=0, description="Surface added, as a share of the surface that was there.")
    tolerance: float = Field(ge=0, description="What lies nearer to its mirror image than this is not missing.")
    seam_distance: float = Field(
        ge=0, description="Farthest that the rim of an added part was moved to close the seam."
    )
    symmetrized: bool
    warnings: list[str] = Field(default=[], description=_WARNINGS)


class CompletedMesh(Schema):
    """What a worker answers beside the mesh itself; a client gets the part ``completion``."""

    completion: Completion
    mesh: MeshInfo
    timings_ms: Timings
    complete_ms: float = Field(ge=0)


class Half(Schema):
    """What `/halve` did, in the header `PRSNet-Half`: the plane is normal·x + offset = 0, input coordinates."""

    normal: Vector
    offset: float
    detected: bool = Field(description="Found here, not given with the request.")
    side: Literal["positive", "negative"] = Field(description="The side that was kept: that of the normal, or not.")
    capped: bool = Field(default=False, description="The cut is closed, so that half a solid is a solid.")
    points: Annotated[list[Vector], Field(min_length=3, max_length=3)] = Field(
        description="Three points of the plane that are not on a line: datum points for CAD and FEM programs."
    )
    calculix: str = Field(default="", description=_CALCULIX)
    freecad: str = Field(default="", description=_FREECAD)
    faces: int = Field(ge=0)
    warnings: list[str] = Field(default=[], description=_WARNINGS)


class HalvedMesh(Schema):
    """What a worker answers beside half a mesh; a client gets the part ``half``."""

    half: Half
    mesh: MeshInfo
    timings_ms: Timings


class CutPlane(Schema):
    """A plane that a sector was cut at: the points x with normal·x + offset = 0, input coordinates."""

    normal: Vector = Field(description="Unit normal; it points into the sector.")
    offset: float


class Sector(Schema):
    """What `/sector` did, in the header `PRSNet-Sector`: one of n equal parts around an axis, input coordinates."""

    order: int = Field(ge=2, description="How many sectors make up the whole.")
    angle: float = Field(gt=0, le=180, description="Of the sector, degrees.")
    direction: Vector = Field(description="Unit direction of the axis.")
    ends: Annotated[list[Vector], Field(min_length=2, max_length=2)] = Field(
        description="Two points on the axis: at the lower and upper end of the whole mesh."
    )
    dependent: CutPlane = Field(description="Turned by the angle about the axis it becomes the independent one.")
    independent: CutPlane
    detected: bool = Field(description="The axis was found here, not given with the request.")
    max_distance: float | None = Field(
        ge=0, description="Largest deviation that the symmetry of a detected axis has, input units."
    )
    capped: bool = Field(description="Both cuts are closed, so that the sector of a solid is a solid.")
    calculix: str = Field(default="", description=_CALCULIX)
    freecad: str = Field(default="", description=_FREECAD)
    faces: int = Field(ge=0)
    warnings: list[str] = Field(default=[], description="What was left out or guessed when the file was read.")


class SectorMesh(Schema):
    """What a worker answers beside a sector; a client gets the part ``sector``."""

    sector: Sector
    mesh: MeshInfo
    timings_ms: Timings


class Alignment(Schema):
    """What `/align` did, in the header `PRSNet-Alignment`."""

    matrix: Matrix = Field(description="Rotation and shift, rows of a 4x4 matrix for column vectors.")
    point_group: str = Field(description="Of the mesh, as `/detect` names it.")
    warnings: list[str] = Field(default=[], description=_WARNINGS)


class AlignedMesh(Schema):
    """What a worker answers beside a mesh laid along the axes; a client gets the part ``alignment``."""

    alignment: Alignment
    mesh: MeshInfo
    timings_ms: Timings
