"""What ``/openapi.json`` and ``/docs`` say beyond the schemas: texts, examples, every error.

``python docs/make_openapi.py`` renews the copy in the repository; a test compares the two.
"""

import json
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from fastapi.responses import PlainTextResponse, Response

from app import edit_schemas, problems, schemas
from app.http import answer_cache, auth
from app.http.middleware import HEADER
from app.http.uploads import FIELD
from app.outputs.output_format import Options, OutputFormat
from app.outputs.registry import DETECT_OUTPUTS, OUTPUTS
from app.problems import MEDIA_TYPE, ProblemType
from model.formats import format_list

TITLE = "PRS-Net"
SUMMARY = "Finds the mirror planes and rotation axes of a 3D mesh."
DESCRIPTION = f"""\
Send a mesh, get its symmetries in the file's own coordinates:

```
curl -F file=@chair.obj http://127.0.0.1:8000/detect
```

**Formats**: {format_list()}; told from the file's name, checked
against its content. Files that a `.gltf` file refers to go beside it, in the same field:
`curl -F file=@chair.gltf -F file=@chair.bin URL`.

The answer is JSON. `format=`, or the header Accept, asks for an annotated GLB to look at, a BOP `models_info.json`
entry, SHREC text, or CSV.

**Errors** are `application/problem+json` (RFC 9457). Their `type` is stable, their `detail` says what to do,
and `request_id` (also in the header `X-Request-ID`, which a client may send) finds the request in the log.

**Files sent again**: answers are kept for a while (`PRSNet-Cache: hit` or `miss`). A `hit` has the timings of the first
time. The `ETag` of an answer stands for the file, its name, the options and the weights: sent back as `If-None-Match`
with the same file, it is answered with 304 and no body, and nothing is computed.

**Frames**: all coordinates are in the input frame. Symmetry errors are mean squared distances in the unit
frame (surface centroid at the origin, bounding sphere of diameter 1): one threshold serves every object.
"""

_EXAMPLE_PLANE = {
    "normal": [1.0, 0.0, 0.0],
    "offset": -0.5,
    "point": [0.5, 0.42, 0.3],
    "matrix": [[-1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]],
    "symmetry_error": 1.2e-17,
    "rms_distance": 4.5e-9,
    "max_distance": 1.3e-8,
    "coverage": 1.0,
    "confidence": 1.0,
    "evidence": "measured",
    "exact": True,
    "continuous": False,
}
_EXAMPLE_RESPONSE: dict[str, Any] = {
    "planes": [_EXAMPLE_PLANE],
    "axes": [],
    "point_group": "Cs",
    "frame": {"coordinates": "input", "units": None, "center": [0.5, 0.42, 0.3], "scale": 1.3},
    "mesh": {
        "filename": "chair.obj",
        "format": "obj",
        "vertices": 120,
        "faces": 260,
        "bounds": [[0.0, 0.0, 0.0], [1.0, 0.9, 0.6]],
        "watertight": True,
        "kind": "mesh",
    },
    "model": {"name": "prs-net", "version": "1", "sha256": "0" * 64},
    "timings_ms": {"parse": 0.2, "voxelize": 0.3, "infer": 1.1, "refine": 0.0, "validate": 2.0, "total": 3.7},
    "warnings": [],
    "levels": [
        {
            "point_group": "Cs",
            "planes": 1,
            "axes": 0,
            "rms_distance": 0.0,
            "next_rms_distance": None,
            "missing": 0.0,
            "confidence": 1.0,
            "evidence": "measured",
            "exact": True,
            "chosen": True,
            "breaks": [],
        }
    ],
    "similar": [],
}
_JSON = "application/json"
_BINARY = {"schema": {"type": "string", "format": "binary"}}


def _content(output: OutputFormat) -> dict[str, Any]:
    """The media type object of an answer of ``POST /detect``."""
    described = {"description": output.description}
    if output.write is None:
        return {**_BINARY, **described}
    if output.schema is not None:
        return {"schema": output.schema, **described}
    response = schemas.DetectResponse.model_validate(_EXAMPLE_RESPONSE)
    return {"schema": {"type": "string"}, **described, "example": output.write(response, Options(4e-4)).decode()}


def _errors(*kinds: ProblemType) -> dict[int | str, dict[str, Any]]:
    """Response objects for ``kinds``, those of one status together."""
    responses: dict[int | str, dict[str, Any]] = {}
    for kind in kinds:
        entry = responses.setdefault(
            kind.status,
            {"description": "", "content": {MEDIA_TYPE: {"schema": _ref("Problem"), "examples": {}}}},
        )
        entry["description"] = " or ".join(filter(None, [entry["description"], kind.title]))
        example: dict[str, Any] = {"value": problems.body(kind, kind.example, "4e1f0c52a7b84d0e9c3d6a5b7f812390")}
        entry["content"][MEDIA_TYPE]["examples"][kind.slug] = example
        if kind.status == problems.OVERLOADED.status:
            entry["headers"] = {"Retry-After": {"description": "Seconds to wait.", "schema": {"type": "integer"}}}
    return responses


def _ref(name: str) -> dict[str, str]:
    return {"$ref": f"#/components/schemas/{name}"}


_UPLOAD_BODY = {
    "required": True,
    "content": {
        "multipart/form-data": {
            "schema": {
                "type": "object",
                "required": [FIELD],
                "properties": {
                    FIELD: {
                        "type": "array",
                        "items": {"type": "string", "format": "binary"},
                        "minItems": 1,
                        "description": "The mesh; its file name's extension tells the format. Files that it refers "
                        "to may follow, in the same field.",
                    }
                },
            }
        }
    },
}

_CONDITION: list[dict[str, Any]] = [
    {
        "name": "If-None-Match",
        "in": "header",
        "required": False,
        "schema": {"type": "string"},
        "description": "The `ETag` of an answer at hand: 304 if the same file and options would be answered the same.",
    }
]
_NOT_MODIFIED: dict[str, Any] = {
    "description": "The answer is the one whose ETag came in If-None-Match; nothing was computed.",
    "headers": {"ETag": {"description": "As in the answer.", "schema": {"type": "string"}}},
}
_KEPT_HEADERS: dict[str, Any] = {
    "ETag": {
        "description": "Stands for the file, the options and the weights; not sent if the service keeps no answers.",
        "schema": {"type": "string"},
    },
    answer_cache.HEADER: {
        "description": "`hit`: the answer was kept from before, its timings too; `miss`: it was computed.",
        "schema": {"type": "string", "enum": ["hit", "miss"]},
    },
}

_UPLOAD_PROBLEMS = (
    problems.MALFORMED,
    problems.UNAUTHORIZED,
    problems.INVALID_PARAMETER,
    problems.UPLOAD_TOO_SLOW,
    problems.UPLOAD_TOO_LARGE,
    problems.MESH_TOO_LARGE,
    problems.UNSUPPORTED_FORMAT,
    problems.UNREADABLE_MESH,
    problems.EMPTY_MESH,
    problems.DEGENERATE_MESH,
    problems.TOO_COMPLEX,
    problems.INTERNAL,
    problems.OVERLOADED,
    problems.WORKER_LOST,
    problems.NOT_READY,
    problems.DEADLINE,
)

DETECT: dict[str, Any] = {
    "tags": ["symmetry"],
    "summary": "Find the symmetries of a mesh",
    "response_model": None,
    "responses": {
        200: {
            "model": schemas.DetectResponse,
            "description": "The symmetries; empty lists if there are none.",
            "content": {output.media_type: _content(output) for output in DETECT_OUTPUTS.values()},
            "headers": _KEPT_HEADERS,
        },
        304: _NOT_MODIFIED,
        **_errors(*_UPLOAD_PROBLEMS, problems.NOT_ACCEPTABLE),
    },
    "openapi_extra": {
        "requestBody": _UPLOAD_BODY,
        "parameters": _CONDITION,
        "x-codeSamples": [
            {
                "lang": "Shell",
                "label": "curl",
                "source": "curl -F file=@chair.obj http://127.0.0.1:8000/detect",
            },
            {
                "lang": "Shell",
                "label": "curl, BOP JSON",
                "source": "curl -F file=@part.stl 'http://127.0.0.1:8000/detect?format=bop'",
            },
            {
                "lang": "Shell",
                "label": "curl, picture",
                "source": "curl -F file=@part.stl -o part.glb 'http://127.0.0.1:8000/detect?format=glb'",
            },
        ],
    },
}


def _mesh_answer(
    summary: str,
    description: str,
    header: str,
    schema: str,
    example: str,
    missing: problems.ProblemType = problems.NO_PLANE,
) -> dict[str, Any]:
    """A path that answers with a mesh, and in a header with what was done."""
    done = {"description": "What was done, as JSON.", "content": {_JSON: {"schema": _ref(schema)}}}
    name = {"description": "A name for the file.", "schema": {"type": "string"}}
    return {
        "tags": ["symmetry"],
        "summary": summary,
        "response_model": None,
        "response_class": Response,
        "responses": {
            200: {
                "description": description,
                "content": {output.media_type: _BINARY for output in OUTPUTS if output.mesh is not None},
                "headers": {**_KEPT_HEADERS, header: done, "Content-Disposition": name},
            },
            304: _NOT_MODIFIED,
            **_errors(*_UPLOAD_PROBLEMS, missing),
        },
        "openapi_extra": {
            "requestBody": _UPLOAD_BODY,
            "parameters": _CONDITION,
            "x-codeSamples": [{"lang": "Shell", "label": "curl", "source": f"curl {example}"}],
        },
    }


COMPLETE = _mesh_answer(
    "Complete a mesh by its mirror image",
    "The completed mesh as a file, in the mesh's own coordinates.",
    edit_schemas.COMPLETION,
    "Completion",
    "-F file=@scan.ply -o completed.ply 'http://127.0.0.1:8000/complete?max_error=2e-3'",
)
HALVE = _mesh_answer(
    "Keep half of a mesh",
    "The half as a file, in the mesh's own coordinates, open where it was cut, or closed there.",
    edit_schemas.HALF,
    "Half",
    "-F file=@part.stl -o half.stl 'http://127.0.0.1:8000/halve?format=stl'",
)
SECTOR = _mesh_answer(
    "Keep a cyclic sector of a mesh",
    "One of n equal sectors as a file, in the mesh's own coordinates; the header has lines for CalculiX and FreeCAD.",
    edit_schemas.SECTOR,
    "Sector",
    "-F file=@vase.ply -o sector.stl 'http://127.0.0.1:8000/sector?format=stl'",
    problems.NO_AXIS,
)
ALIGN = _mesh_answer(
    "Lay a mesh along the axes",
    "The moved copy as a file: its symmetry plane on YZ, its main axis on Z.",
    edit_schemas.ALIGNMENT,
    "Alignment",
    "-F file=@part.stl -o aligned.glb 'http://127.0.0.1:8000/align?format=glb'",
)
HEALTH: dict[str, Any] = {
    "tags": ["operation"],
    "summary": "Readiness",
    "responses": _errors(problems.NOT_READY),
}
LIVE: dict[str, Any] = {"tags": ["operation"], "summary": "Liveness"}
MODEL: dict[str, Any] = {
    "tags": ["operation"],
    "summary": "Model card",
    "responses": _errors(problems.UNAUTHORIZED, problems.NOT_READY),
}


METRICS: dict[str, Any] = {
    "tags": ["operation"],
    "summary": "Metrics for Prometheus",
    "response_class": PlainTextResponse,
    "responses": _errors(problems.UNAUTHORIZED),
}
_KEYS: dict[str, Any] = {
    "key": {"type": "apiKey", "in": "header", "name": auth.HEADER, "description": "Where the operator asks for one."},
    "bearer": {"type": "http", "scheme": "bearer", "description": "The same key."},
}


_DESCRIBED = (
    schemas.Problem,
    edit_schemas.Completion,
    edit_schemas.Half,
    edit_schemas.Sector,
    edit_schemas.Alignment,
    schemas.BopEntry,
)


def build(app: FastAPI) -> dict[str, Any]:
    """The OpenAPI document of ``app``."""
    document = get_openapi(
        title=app.title,
        version=app.version,
        summary=app.summary,
        description=app.description,
        routes=app.routes,
    )
    # Put in afterwards, because FastAPI drops members that are null from what it is given.
    answers = document["paths"]["/detect"]["post"]["responses"]
    answers["200"]["content"]["application/json"]["example"] = _EXAMPLE_RESPONSE
    for schema in _DESCRIBED:
        described = schema.model_json_schema(ref_template="#/components/schemas/{model}")
        document["components"]["schemas"].update(described.pop("$defs", {}))
        document["components"]["schemas"][schema.__name__] = described
    document["components"]["securitySchemes"] = _KEYS
    returned_id = {HEADER: {"description": "The request's id.", "schema": {"type": "string"}}}
    for operations in document["paths"].values():
        for operation in operations.values():
            if "401" in operation["responses"]:
                operation["security"] = [{}, *({name: list[str]()} for name in _KEYS)]
            for answer in operation["responses"].values():
                answer["headers"] = {**answer.get("headers", {}), **returned_id}
    return document


def install(app: FastAPI) -> None:
    """Make ``/openapi.json`` say what ``build`` says."""

    def cached() -> dict[str, Any]:
        if app.openapi_schema is None:
            app.openapi_schema = build(app)
        return app.openapi_schema

    app.openapi = cached


def dump(app: FastAPI) -> str:
    """The document as the text kept in ``docs/openapi.json``."""
    return json.dumps(app.openapi(), indent=2, ensure_ascii=False) + "\n"
