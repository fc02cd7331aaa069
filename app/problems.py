"""Every error this service answers with, as ``application/problem+json`` (RFC 9457).

``type`` is stable and relative (``/problems/unreadable-mesh``); ``detail`` is a sentence a person can act on,
and never quotes file content or the text of an unexpected exception.
"""

from dataclasses import dataclass
from http import HTTPStatus
from typing import Any, cast

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect
from starlette.responses import Response

from app.queries import QUERIES
from app.refusals import reason
from model.errors import (
    DegenerateMeshError,
    EmptyMeshError,
    MeshError,
    MeshTooLargeError,
    NoAxisError,
    NoPlaneError,
    TooComplexError,
    UnreadableMeshError,
    UnsupportedFormatError,
)

MEDIA_TYPE = "application/problem+json"
CLIENT_LEFT = 499  # as proxies log it


@dataclass(frozen=True, slots=True)
class ProblemType:
    """A kind of error: the last part of its ``type``, its status, its title, an example of its ``detail``."""

    slug: str
    status: int
    title: str
    example: str

    @property
    def uri(self) -> str:
        """The ``type`` member."""
        return f"/problems/{self.slug}"


MALFORMED = ProblemType(
    "malformed-request", 400, "Malformed request",
    'The form has no field "file". Send the mesh as multipart/form-data: curl -F file=@chair.obj URL.',
)  # fmt: skip
INVALID_PARAMETER = ProblemType(
    "invalid-parameter", 400, "Invalid parameter", "mode: Input should be 'full' or 'paper'."
)
UNAUTHORIZED = ProblemType(
    "unauthorized", 401, "Unauthorized",
    "The request needs a key, in the header X-API-Key or as Authorization: Bearer.",
)  # fmt: skip
NOT_FOUND = ProblemType("not-found", 404, "Not found", "There is nothing at this address; see /docs.")
METHOD_NOT_ALLOWED = ProblemType(
    "method-not-allowed", 405, "Method not allowed", "This address does not answer GET; it answers POST."
)
NOT_ACCEPTABLE = ProblemType(
    "not-acceptable", 406, "Not acceptable",
    "The header Accept names none of application/json, model/gltf-binary, text/csv, text/plain.",
)  # fmt: skip
UPLOAD_TOO_SLOW = ProblemType(
    "upload-too-slow",
    408,
    "Upload too slow",
    "An upload may take 30 seconds, pause for 10, and must bring 4096 bytes a second on average.",
)
UPLOAD_TOO_LARGE = ProblemType(
    "upload-too-large", 413, "Upload too large", "The upload is larger than the limit of 67108864 bytes."
)
MESH_TOO_LARGE = ProblemType(
    "mesh-too-large", 413, "Mesh too large", "The mesh has more than the 5000000 faces allowed."
)
UNSUPPORTED_FORMAT = ProblemType(
    "unsupported-format", 415, "Unsupported format",
    'There is no reader for ".docx" files. Supported: stl, obj, ply, off, glb, gltf, 3mf.',
)  # fmt: skip
UNREADABLE_MESH = ProblemType(
    "unreadable-mesh", 422, "Unreadable mesh", "The file ends before the 468 faces its header announces."
)
EMPTY_MESH = ProblemType("empty-mesh", 422, "Empty mesh", "The file holds no faces.")
DEGENERATE_MESH = ProblemType(
    "degenerate-mesh", 422, "Degenerate mesh", "The mesh has coordinates that are not finite numbers."
)
TOO_COMPLEX = ProblemType(
    "mesh-too-complex", 422, "Mesh too complex",
    "The mesh is too complex: so many of its faces cross or crowd each other that distances to it cannot be measured "
    "in the time a request may take. Send its outer surface alone, or a simplified mesh.",
)  # fmt: skip
NO_PLANE = ProblemType(
    "no-plane", 422, "No mirror plane",
    "No mirror plane has an error of at most 0.0004; the best has 0.0021. Give a larger max_error, or a plane.",
)  # fmt: skip
NO_AXIS = ProblemType(
    "no-axis", 422, "No rotation axis",
    "No rotation axis has an error of at most 0.0004. Give a larger max_error, or axis, point and order.",
)  # fmt: skip
INTERNAL = ProblemType(
    "internal-error", 500, "Internal error",
    "This is a defect of the service. Report it with the request id.",
)  # fmt: skip
OVERLOADED = ProblemType(
    "overloaded",
    503,
    "Overloaded",
    "All workers are busy, and the queue is full or your share of it is. Try again in a second.",
)
UPLOADS_FULL = ProblemType(
    "overloaded", 503, "Overloaded",
    "Too many uploads at a time, in all or from this address. Try again in a second.",
)  # fmt: skip
WORKER_LOST = ProblemType(
    "worker-lost", 503, "Worker lost",
    "The process that worked on the mesh was killed, and so was the next one. Try again in a second.",
)  # fmt: skip
NOT_READY = ProblemType("not-ready", 503, "Not ready", "The service is starting: its weights are being loaded.")
DEADLINE = ProblemType(
    "deadline-passed", 504, "Deadline passed", "The request took longer than the 60 seconds allowed."
)

_MESH_PROBLEMS: dict[type[MeshError], ProblemType] = {
    UnsupportedFormatError: UNSUPPORTED_FORMAT,
    UnreadableMeshError: UNREADABLE_MESH,
    EmptyMeshError: EMPTY_MESH,
    DegenerateMeshError: DEGENERATE_MESH,
    MeshTooLargeError: MESH_TOO_LARGE,
    TooComplexError: TOO_COMPLEX,
    NoPlaneError: NO_PLANE,
    NoAxisError: NO_AXIS,
}


TOO_MUCH_MEMORY = "The mesh needs more memory than a request may take; send one with fewer faces."


class ProblemError(Exception):
    """Raised anywhere below a route to answer with ``problem``; ``headers`` are added to the answer."""

    def __init__(self, problem: ProblemType, detail: str, headers: dict[str, str] | None = None) -> None:
        super().__init__(detail)
        self.problem = problem
        self.detail = detail
        self.headers = headers or {}


def request_id(request: Request) -> str:
    """The id the middleware gave to the request (or took from its ``X-Request-ID``)."""
    return cast(str, request.scope.get("request_id", ""))


def body(problem: ProblemType, detail: str, request_id: str, **more: Any) -> dict[str, Any]:
    """The members of a problem document."""
    return {
        "type": problem.uri,
        "title": problem.title,
        "status": problem.status,
        "detail": detail,
        "request_id": request_id,
        **more,
    }


def response(
    request: Request, problem: ProblemType, detail: str, headers: dict[str, str] | None = None, **more: Any
) -> Response:
    """The answer for ``problem``."""
    request.scope["problem"] = problem.slug  # for the log and the metrics
    content = body(problem, detail, request_id(request), **more)
    return JSONResponse(content, problem.status, headers=headers, media_type=MEDIA_TYPE)


def for_mesh_error(error: MeshError) -> ProblemType:
    """The problem that stands for an error of ``model.errors``."""
    for kind, problem in _MESH_PROBLEMS.items():
        if isinstance(error, kind):
            return problem
    return UNREADABLE_MESH


def _on_problem(request: Request, error: Exception) -> Response:
    assert isinstance(error, ProblemError)
    return response(request, error.problem, error.detail, error.headers)


def _on_mesh_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, MeshError)
    return response(request, for_mesh_error(error), str(error))


def _on_validation_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    # `loc` starts with "query"/"path"; the rejected input itself is not echoed.
    query = QUERIES.get(getattr(request.scope.get("route"), "path", ""))
    names = () if query is None else query.model_fields
    errors = [
        {"parameter": ".".join(str(part) for part in item["loc"][1:]), "message": reason(item, names)}
        for item in error.errors()
    ]
    detail = "; ".join(f"{item['parameter']}: {item['message']}" for item in errors) + "."
    return response(request, INVALID_PARAMETER, detail, errors=errors)


def _on_http_exception(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    headers = dict(error.headers or {})
    if error.status_code == NOT_FOUND.status:
        return response(request, NOT_FOUND, NOT_FOUND.example, headers)
    if error.status_code == METHOD_NOT_ALLOWED.status:
        allowed = headers.get("Allow", headers.get("allow", "another method"))
        detail = f"This address does not answer {request.method}; it answers {allowed}."
        return response(request, METHOD_NOT_ALLOWED, detail, headers)
    status = HTTPStatus(error.status_code)
    slug = status.phrase.lower().replace(" ", "-")
    return response(request, ProblemType(slug, status, status.phrase, ""), f"{status.description or status.phrase}.")


def _on_disconnect(request: Request, error: Exception) -> Response:
    # Nobody is left to read this; it ends the request in an orderly way, and the log and the metrics show it.
    request.scope["problem"] = "client-left"
    return Response(status_code=CLIENT_LEFT)


def install(app: FastAPI) -> None:
    """Register the handlers. What none takes is a defect: the middleware answers it with ``INTERNAL``."""
    app.add_exception_handler(ProblemError, _on_problem)
    app.add_exception_handler(MeshError, _on_mesh_error)
    app.add_exception_handler(RequestValidationError, _on_validation_error)
    app.add_exception_handler(HTTPException, _on_http_exception)
    app.add_exception_handler(ClientDisconnect, _on_disconnect)
