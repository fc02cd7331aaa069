"""From a checked answer to the HTTP response: which format, which headers."""

from starlette.responses import Response

from app import edit_schemas, queries, schemas
from app.http.attachment import Attachment, disposition
from app.http.runtime import Runtime
from app.outputs.fem import half_with_lines, sector_with_lines
from app.outputs.negotiation import MEDIA_TYPES, Choice, choose
from app.outputs.output_format import Options
from app.outputs.registry import OUTPUTS
from app.problems import NOT_ACCEPTABLE, OVERLOADED, ProblemError
from app.workers.verify import Answer

_VARY = {"Vary": "Accept"}
_MEDIA_TYPES = {output.name: output.media_type for output in OUTPUTS}


def wanted_format(query: queries.DetectQuery, accept: str | None) -> Choice:
    """What to answer ``POST /detect`` with.

    Raises:
        ProblemError: ``not-acceptable`` (406).
    """
    choice = choose(query.format, accept)
    if choice is None:
        raise ProblemError(NOT_ACCEPTABLE, f"The header Accept names none of {', '.join(MEDIA_TYPES)}.", _VARY)
    return choice


def detected(runtime: Runtime, answer: Answer, query: queries.DetectQuery, choice: Choice) -> Response:
    """The response of ``POST /detect``.

    Raises:
        ProblemError: ``overloaded`` (503).
    """
    response = answer.content
    assert isinstance(response, schemas.DetectResponse)
    output = choice.output
    if output.write is not None:
        content = output.write(response, Options(query.max_error, query.include))
        # Not made by Starlette, which would add a charset to any text; ours say what they are.
        return Response(content, headers={**_VARY, "Content-Type": _named(choice)})
    ending = f"-symmetries.{output.name}"
    headers = {**_VARY, "Content-Disposition": disposition(response.mesh.filename, ending)}
    return _attached(runtime, answer.file, headers, choice.media_type)


def not_modified(headers: dict[str, str]) -> Response:
    """The client has the answer already: 304 (RFC 9110, 15.4.5)."""
    return Response(status_code=304, headers={**_VARY, **headers})


def with_headers(response: Response, headers: dict[str, str]) -> Response:
    """A response with further headers."""
    response.headers.update(headers)
    return response


def edited(runtime: Runtime, answer: Answer, format: str) -> Response:
    """The response of ``/complete``, ``/halve``, ``/sector`` and ``/align``: a mesh, and in a header what was done.

    Raises:
        ProblemError: ``overloaded`` (503).
    """
    content = answer.content
    match content:
        case edit_schemas.CompletedMesh():
            header, done, word = edit_schemas.COMPLETION, content.completion, "completed"
        case edit_schemas.HalvedMesh():
            header, done, word = edit_schemas.HALF, half_with_lines(content.half), "half"
        case edit_schemas.SectorMesh():
            header, done, word = edit_schemas.SECTOR, sector_with_lines(content.sector), "sector"
        case edit_schemas.AlignedMesh():
            header, done, word = edit_schemas.ALIGNMENT, content.alignment, "aligned"
        case schemas.DetectResponse():
            raise TypeError("not a mesh")
    headers = {
        header: done.model_dump_json(),
        "Content-Disposition": disposition(content.mesh.filename, f"-{word}.{format}"),
    }
    return _attached(runtime, answer.file, headers, _MEDIA_TYPES[format])


def _named(choice: Choice) -> str:
    return f"{choice.media_type}; charset=utf-8" if choice.media_type.startswith("text/") else choice.media_type


def _attached(runtime: Runtime, parts: list[bytes], headers: dict[str, str], media_type: str) -> Response:
    settings = runtime.settings
    size = sum(map(len, parts))
    if runtime.sending_bytes + size > settings.sending_bytes:
        detail = "Too many answers are on their way to clients. Try again in a few seconds."
        raise ProblemError(OVERLOADED, detail, {"Retry-After": "5"})
    runtime.sending_bytes += size

    def end() -> None:
        runtime.sending_bytes -= size

    return Attachment(
        parts, headers, media_type, stall_s=settings.stall_s, seconds=settings.deadline_s, on_end=end
    )  # fmt: skip
