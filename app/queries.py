"""The queries of the service's endpoints."""

import math
from typing import TYPE_CHECKING, Literal, TypeAlias

from pydantic import Field, ValidationInfo, field_validator
from pydantic_core import PydanticCustomError

from app.outputs.registry import DETECT_OUTPUTS, MESH_WRITERS
from app.schemas import Include, LevelName, Mode, Schema

if TYPE_CHECKING:  # a type checker cannot read the names out of the records
    _DetectFormat: TypeAlias = str
    _MeshFormat: TypeAlias = str
else:
    _DetectFormat = Literal[tuple(DETECT_OUTPUTS)]
    _MeshFormat = Literal[tuple(MESH_WRITERS)]


class DetectQuery(Schema):
    """Options of ``POST /detect``."""

    mode: Mode = Field(
        default="full",
        description="`full`: all symmetries, refined. `paper`: the network's output, validated as there.",
    )
    max_error: float = Field(
        default=4e-4,
        gt=0,
        le=1,
        description="Largest symmetry error of a result, unit frame (the paper's threshold).",
    )
    level: LevelName = Field(
        default="auto",
        description="Of the groups that hold, which one is answered with: `auto`, the one with the most room above it; "
        "`exact`, the largest that holds everywhere up to what the file promises. Full mode only.",
    )
    tolerance: float | None = Field(
        default=None,
        gt=0,
        le=1e60,
        description="Instead of a level: the largest group within this RMS deviation, input units. Full mode only.",
    )
    include: list[Include] = Field(
        default=[], description="Also return rejected candidates, or the result as BOP JSON. Repeatable."
    )
    format: _DetectFormat | None = Field(
        default=None,
        description="What to answer with; without it the header Accept decides, and without both it is JSON.",
    )


class MeshQuery(Schema):
    """Options of what answers with a mesh."""

    format: _MeshFormat = Field(default="ply", description="File format of the answer.")
    max_error: float = Field(
        default=4e-4,
        gt=0,
        le=1,
        description="Largest symmetry error of what is detected; a damaged mesh may need more.",
    )


class AlignQuery(MeshQuery):
    """Options of ``POST /align``."""


class PlaneQuery(MeshQuery):
    """Options of what is done at a plane."""

    normal: str | None = Field(
        default=None,
        max_length=200,
        description="Normal of the plane, as x,y,z of any length, with `offset`. Default: the best plane detected.",
        examples=["1,0,0"],
    )
    offset: float | None = Field(
        default=None, ge=-1e60, le=1e60, description="The plane is normal·x + offset = 0 in input coordinates."
    )

    @field_validator("normal")
    @classmethod
    def _three_numbers(cls, value: str | None) -> str | None:
        if value is not None:
            _direction(value)
        return value

    @field_validator("offset")
    @classmethod
    def _with_normal(cls, value: float | None, info: ValidationInfo) -> float | None:
        if value is not None and info.data.get("normal", "") is None:
            raise PydanticCustomError("alone", "needs normal as well")
        return value

    @property
    def plane(self) -> list[float] | None:
        """Unit normal and offset, or None where the plane is to be detected."""
        if self.normal is None:
            return None
        vector = _direction(self.normal)
        return [*_unit(vector), (self.offset or 0.0) / math.hypot(*vector)]


class CompleteQuery(PlaneQuery):
    """Options of ``POST /complete``."""

    symmetrize: bool = Field(default=False, description="Also average both halves, so that they become equal.")


class HalveQuery(PlaneQuery):
    """Options of ``POST /halve``."""

    other: bool = Field(default=False, description="Keep the side that the normal points away from.")
    capped: bool = Field(default=False, description="Close the cut, so that half a solid is a solid.")


class SectorQuery(MeshQuery):
    """Options of ``POST /sector``."""

    order: int | None = Field(
        default=None,
        ge=2,
        le=1000,
        description="How many sectors make up the whole. Default: the order of the axis; else a divisor of it.",
    )
    axis: str | None = Field(
        default=None,
        max_length=200,
        description="Direction of the axis, as x,y,z of any length, with `point` and `order`. "
        "Default: the detected axis of the highest order.",
        examples=["0,0,1"],
    )
    point: str | None = Field(default=None, max_length=200, description="A point on that axis, as x,y,z (0,0,0).")
    start: str | None = Field(
        default=None,
        max_length=200,
        description="Which way from the axis the first cut goes, as x,y,z. Default: where the cuts are short.",
    )
    capped: bool = Field(default=True, description="Close both cuts, so that the sector of a solid is a solid.")

    @field_validator("axis", "start")
    @classmethod
    def _directions(cls, value: str | None) -> str | None:
        if value is not None:
            _direction(value)
        return value

    @field_validator("axis")
    @classmethod
    def _with_order(cls, value: str | None, info: ValidationInfo) -> str | None:
        if value is not None and info.data.get("order", 0) is None:
            raise PydanticCustomError("alone", "needs order as well")
        return value

    @field_validator("point")
    @classmethod
    def _with_axis(cls, value: str | None, info: ValidationInfo) -> str | None:
        if value is not None:
            _numbers(value)
            if info.data.get("axis", "") is None:
                raise PydanticCustomError("alone", "needs axis as well")
        return value

    @field_validator("start")
    @classmethod
    def _beside_axis(cls, value: str | None, info: ValidationInfo) -> str | None:
        if value is not None and info.data.get("axis") is not None:
            start, axis = _unit(_direction(value)), _unit(_direction(info.data["axis"]))
            if abs(sum(a * b for a, b in zip(start, axis, strict=True))) > 1.0 - 1e-9:
                raise PydanticCustomError("along", "lies along the axis")
        return value

    @property
    def line(self) -> list[float] | None:
        """Unit direction of the axis and a point on it, or None where it is to be detected."""
        if self.axis is None:
            return None
        return [*_unit(_direction(self.axis)), *_numbers(self.point or "0,0,0")]

    @property
    def way(self) -> list[float] | None:
        """Which way the first cut goes, or None."""
        return None if self.start is None else _unit(_direction(self.start))


QUERIES: dict[str, type[Schema]] = {
    "/detect": DetectQuery,
    "/complete": CompleteQuery,
    "/halve": HalveQuery,
    "/sector": SectorQuery,
    "/align": AlignQuery,
}
"""What each path of the service takes."""


def _direction(text: str) -> list[float]:
    vector = _numbers(text)
    if not math.hypot(*vector) > 1e-60:
        raise PydanticCustomError("direction", "should be three numbers that are not all zero, as in 1,0,0")
    return vector


def _numbers(text: str) -> list[float]:
    try:
        vector = [float(part) for part in text.split(",")]
    except ValueError:
        raise PydanticCustomError("direction", "should be three numbers, as in 1,0,0") from None
    if len(vector) != 3 or not math.hypot(*vector) < 1e60:
        raise PydanticCustomError("direction", "should be three numbers, as in 1,0,0")
    return vector


def _unit(vector: list[float]) -> list[float]:
    length = math.hypot(*vector)
    return [value / length for value in vector]
