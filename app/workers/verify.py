"""Why the server believes an answer: a worker may have been taken over by the file it parsed.

The answer is parsed against the schema (all numbers finite, lists of the right length), compared with what was asked,
bounded, and written anew: not a byte of the worker's own JSON reaches a client.
"""

import re
from collections.abc import Iterable

from pydantic import ValidationError

from app import schemas
from app.workers.factory import Card
from app.workers.wire import Job
from model import errors

LARGEST_ANSWER = 16 << 20
"""Bytes of an answer's JSON."""

_MOST_ELEMENTS = 10_000
_MOST_WARNINGS = 100
_POINT_GROUP = re.compile(r"[A-Za-z0-9]{1,16}")
_LONGEST_TEXT = 500
_LONGEST_MS = 86_400_000.0
_LARGEST_NUMBER = 1e80
_MESH_ERRORS = {kind.__name__: kind for kind in errors.MeshError.__subclasses__()}


class UntrustedError(Exception):
    """What came back cannot be an answer to the job."""


def trusted_answer(body: bytes, job: Job, card: Card) -> schemas.DetectResponse:
    """The answer, checked.

    Raises:
        UntrustedError: it breaks the schema, or is not about this job.
    """
    try:
        answer = schemas.DetectResponse.model_validate_json(body)
    except ValidationError as error:
        raise UntrustedError("the answer breaks the schema") from error
    _require(answer.mesh.filename == job.filename, "another file's answer")
    _require(answer.mesh.format in card.formats, "an unknown format")
    _require(0 < answer.mesh.faces <= job.max_faces, "a number of faces beyond the limit")
    _require(0 < answer.mesh.vertices <= job.max_vertices, "a number of vertices beyond the limit")
    model = answer.model
    _require((model.name, model.version, model.sha256) == (card.name, card.version, card.sha256), "another model")
    _require(_POINT_GROUP.fullmatch(answer.point_group) is not None, "no point group")
    _require(max(len(answer.planes), len(answer.axes), len(answer.rejected)) <= _MOST_ELEMENTS, "too many elements")
    _require(len(answer.warnings) <= _MOST_WARNINGS, "too many warnings")
    _require(all(map(_is_sentence, [*answer.warnings, answer.frame.units or ""])), "text that is no sentence")
    timings = (getattr(answer.timings_ms, name) for name in schemas.Timings.model_fields)
    _require(all(value <= _LONGEST_MS for value in timings), "impossible timings")
    for plane in answer.planes:
        _require(_is_unit(plane.normal) and _in_range([*plane.point, plane.offset]), "a plane that is none")
    for axis in answer.axes:
        _require(_is_unit(axis.direction) and _in_range(axis.point), "an axis that is none")
        _require(axis.continuous == (axis.order is None) == (axis.matrix is None), "an axis that contradicts itself")
    _require(_in_range([*answer.frame.center, answer.frame.scale]), "a frame out of range")
    return answer


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


def _require(holds: bool, otherwise: str) -> None:
    if not holds:
        raise UntrustedError(otherwise)


def _is_sentence(text: str) -> bool:
    return len(text) <= _LONGEST_TEXT and text.isprintable()


def _in_range(values: Iterable[float]) -> bool:
    return all(abs(value) < _LARGEST_NUMBER for value in values)


def _is_unit(vector: list[float]) -> bool:
    return abs(sum(value * value for value in vector) - 1.0) < 1e-3
