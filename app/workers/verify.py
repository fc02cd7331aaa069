"""Verification of a worker's answer: the worker may have been compromised by the file it parsed.

The answer is parsed against the schema (all numbers finite, lists of the right length), compared with what was asked,
bounded, and written anew: not a byte of the worker's own JSON reaches a client. Of a mesh the worker makes the numbers
alone; all structure around them is written here, and the numbers are checked (see ``app.outputs``).
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TypeAlias, TypeVar

from pydantic import ValidationError

from app import edit_schemas, schemas
from app.outputs.mesh_file import BodyError, Counts
from app.outputs.registry import MESH_WRITERS
from app.workers.wire import Job
from app.workers.zygote_client import Card
from model import errors

LARGEST_ANSWER = 16 << 20
"""Bytes of an answer's JSON."""

_MOST_ELEMENTS = 10_000
_MOST_WARNINGS = 100
_POINT_GROUP = re.compile(r"[A-Za-z0-9]{1,16}")
_LONGEST_TEXT = 500
_LONGEST_MS = 86_400_000.0
_LARGEST_NUMBER = 1e80
_GROWTH = 100
"""So many times the faces and vertices that may come a completed mesh may have: small ones are cut into many."""

_MESH_ERRORS = {kind.__name__: kind for kind in errors.MeshError.__subclasses__()}


class UntrustedError(Exception):
    """What came back cannot be an answer to the job."""


Content: TypeAlias = (
    schemas.DetectResponse
    | edit_schemas.CompletedMesh
    | edit_schemas.HalvedMesh
    | edit_schemas.SectorMesh
    | edit_schemas.AlignedMesh
)


@dataclass(frozen=True, slots=True)
class Answer:
    """A checked answer: what it says, and the parts of the mesh file that goes with it, if one does."""

    content: Content
    file: list[bytes] = field(default_factory=list[bytes])


def trusted(text: bytes, body: bytes | None, job: Job, card: Card) -> Answer:
    """The answer to any job, checked.

    Raises:
        UntrustedError: it breaks the schema, or is not about this job, or its geometry is none.
    """
    content = _TRUSTED[job.task](text, job, card)
    if body is None:
        return Answer(content)
    try:
        writer = MESH_WRITERS[job.geometry or "ply"]
        if isinstance(content, schemas.DetectResponse):
            _require(writer.annotated_head is not None, "a mesh nobody asked for")
            assert writer.annotated_head is not None
            head = writer.annotated_head(content, body)
        else:
            counts = Counts(content.mesh.vertices, content.mesh.faces, content.mesh.bounds)
            head = writer.head(counts, body)
    except BodyError as error:
        raise UntrustedError(f"a mesh with {error}") from error
    return Answer(content, [head, body])


def trusted_completion(text: bytes, job: Job, card: Card) -> edit_schemas.CompletedMesh:
    """The description of a completed mesh, checked.

    Raises:
        UntrustedError: it breaks the schema, or is not about this job.
    """
    answer = _parsed(edit_schemas.CompletedMesh, text)
    done, mesh = answer.completion, answer.mesh
    _require_mesh(mesh, job, card, growth=_GROWTH)
    _require(_is_unit(done.plane.normal) and _in_range([done.plane.offset]), "a plane that is none")
    _require(done.plane.detected == (job.plane is None), "a plane nobody asked for")
    _require(done.symmetrized == job.symmetrize, "another task's answer")
    _require_warnings(done.warnings)
    counts = (done.vertices_kept, done.faces_kept, done.vertices_added, done.faces_added)
    _require(max(counts) <= _GROWTH * max(job.max_faces, job.max_vertices), "an impossible number of faces")
    _require(_in_range([done.area_added, done.tolerance, done.seam_distance]), "no measures")
    _require_timings(answer.timings_ms)
    _require(answer.complete_ms <= _LONGEST_MS, "impossible timings")
    return answer


def trusted_half(text: bytes, job: Job, card: Card) -> edit_schemas.HalvedMesh:
    """The description of half a mesh, checked.

    Raises:
        UntrustedError: it breaks the schema, or is not about this job.
    """
    answer = _parsed(edit_schemas.HalvedMesh, text)
    half = answer.half
    _require_mesh(answer.mesh, job, card, growth=_GROWTH)
    _require(_is_unit(half.normal) and _in_range([half.offset]), "a plane that is none")
    _require(half.detected == (job.plane is None), "a plane nobody asked for")
    _require((half.side == "positive") == job.positive, "another task's answer")
    _require(half.faces == answer.mesh.faces, "counts that contradict each other")
    _require(job.capped or not half.capped, "another task's answer")
    _require(all(map(_in_range, half.points)), "points out of range")
    _require(not (half.calculix or half.freecad), "text that is written elsewhere")
    _require_warnings(half.warnings)
    _require_timings(answer.timings_ms)
    return answer


def trusted_sector(text: bytes, job: Job, card: Card) -> edit_schemas.SectorMesh:
    """The description of a sector, checked.

    Raises:
        UntrustedError: it breaks the schema, or is not about this job.
    """
    answer = _parsed(edit_schemas.SectorMesh, text)
    sector = answer.sector
    _require_mesh(answer.mesh, job, card, growth=_GROWTH)
    _require(_is_unit(sector.direction) and all(map(_in_range, sector.ends)), "an axis that is none")
    for plane in (sector.dependent, sector.independent):
        _require(_is_unit(plane.normal) and _in_range([plane.offset]), "a plane that is none")
    _require(sector.detected == (job.line is None), "an axis nobody asked for")
    _require(sector.order == job.order or (job.order is None and sector.detected), "sectors nobody asked for")
    _require(abs(sector.angle * sector.order - 360.0) < 1e-6, "counts that contradict each other")
    _require(_in_range([sector.max_distance or 0.0]), "no measures")
    _require(job.capped or not sector.capped, "another task's answer")
    _require(sector.faces == answer.mesh.faces, "counts that contradict each other")
    _require(not (sector.calculix or sector.freecad), "text that is written elsewhere")
    _require_warnings(sector.warnings)
    _require_timings(answer.timings_ms)
    return answer


def trusted_alignment(text: bytes, job: Job, card: Card) -> edit_schemas.AlignedMesh:
    """The description of a mesh laid along the axes, checked.

    Raises:
        UntrustedError: it breaks the schema, or is not about this job.
    """
    answer = _parsed(edit_schemas.AlignedMesh, text)
    done = answer.alignment
    _require_mesh(answer.mesh, job, card)
    _require(all(map(_in_range, done.matrix)), "a matrix out of range")
    _require(all(_is_unit(row[:3]) for row in done.matrix[:3]), "a matrix that is no motion")
    _require(_POINT_GROUP.fullmatch(done.point_group) is not None, "no point group")
    _require_warnings(done.warnings)
    _require_timings(answer.timings_ms)
    return answer


def trusted_answer(body: bytes, job: Job, card: Card) -> schemas.DetectResponse:
    """The symmetries, checked.

    Raises:
        UntrustedError: they break the schema, or are not about this job.
    """
    answer = _parsed(schemas.DetectResponse, body)
    _require_mesh(answer.mesh, job, card)
    model = answer.model
    _require((model.name, model.version, model.sha256) == (card.name, card.version, card.sha256), "another model")
    _require(_POINT_GROUP.fullmatch(answer.point_group) is not None, "no point group")
    lists = (answer.planes, answer.axes, answer.rejected, answer.similar, answer.levels)
    _require(max(map(len, lists)) <= _MOST_ELEMENTS, "too many elements")
    _require(len(answer.warnings) <= _MOST_WARNINGS, "too many warnings")
    _require(all(map(_is_sentence, [*answer.warnings, answer.frame.units or ""])), "text that is no sentence")
    _require_timings(answer.timings_ms)
    for plane in answer.planes:
        _require(_is_unit(plane.normal) and _in_range([*plane.point, plane.offset]), "a plane that is none")
    for axis in answer.axes:
        _require(_is_unit(axis.direction) and _in_range(axis.point), "an axis that is none")
        _require(axis.continuous == (axis.order is None) == (axis.matrix is None), "an axis that contradicts itself")
    guessed = [item for item in (*answer.planes, *answer.axes, *answer.levels) if item.evidence == "predicted"]
    _require(not any(item.exact for item in guessed), "a guess that is called exact")
    for level in answer.levels:
        _require(_POINT_GROUP.fullmatch(level.point_group) is not None, "no point group")
        _require(len(level.breaks) <= _MOST_ELEMENTS, "too many elements")
        _require(all(_in_range([*patch.center, patch.size]) for patch in level.breaks), "a place out of range")
    _require(_in_range([*answer.frame.center, answer.frame.scale]), "a frame out of range")
    return answer


_TRUSTED = {
    "detect": trusted_answer,
    "complete": trusted_completion,
    "halve": trusted_half,
    "sector": trusted_sector,
    "align": trusted_alignment,
}


def trusted_error(value: object) -> errors.MeshError:
    """The error of the mesh that a worker reports, as name and message.

    Raises:
        UntrustedError: it is none of ``model.errors``, or its message is not a short, plain sentence.
    """
    match value:
        case [str(name), str(message)] if name in _MESH_ERRORS and message and _is_sentence(message):
            return _MESH_ERRORS[name](message)
        case _:
            raise UntrustedError("an error that is none")


T = TypeVar("T", bound=schemas.Schema)


def _parsed(schema: type[T], text: bytes) -> T:
    try:
        return schema.model_validate_json(text)
    except ValidationError as error:
        raise UntrustedError("the answer breaks the schema") from error


def _require_mesh(mesh: schemas.MeshInfo, job: Job, card: Card, growth: int = 1) -> None:
    _require(mesh.filename == job.filename, "another file's answer")
    _require(mesh.format in card.formats, "an unknown format")
    _require(0 < mesh.faces <= growth * job.max_faces, "a number of faces beyond the limit")
    _require(0 < mesh.vertices <= growth * job.max_vertices, "a number of vertices beyond the limit")
    _require(all(map(_in_range, mesh.bounds)), "bounds out of range")
    _require(all(low <= high for low, high in zip(*mesh.bounds, strict=True)), "bounds that are none")


def _require_warnings(warnings: list[str]) -> None:
    _require(len(warnings) <= _MOST_WARNINGS, "too many warnings")
    # They go into a header, which knows no other letters.
    _require(all(_is_sentence(text) and text.isascii() for text in warnings), "text that is no sentence")


def _require_timings(timings: schemas.Timings) -> None:
    values = (getattr(timings, name) for name in schemas.Timings.model_fields)
    _require(all(value <= _LONGEST_MS for value in values), "impossible timings")


def _require(holds: bool, otherwise: str) -> None:
    if not holds:
        raise UntrustedError(otherwise)


def _is_sentence(text: str) -> bool:
    return len(text) <= _LONGEST_TEXT and text.isprintable()


def _in_range(values: Iterable[float]) -> bool:
    return all(abs(value) < _LARGEST_NUMBER for value in values)


def _is_unit(vector: list[float]) -> bool:
    return abs(sum(value * value for value in vector) - 1.0) < 1e-3
