"""The endpoints. They check, wait and answer; parsing and computing happen on the pool."""

import asyncio
from pathlib import Path
from typing import Annotated, cast

from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import FileResponse, RedirectResponse, Response

from app import __version__, openapi, schemas
from app.detection import MeshLimits, Options, parse_and_detect, to_json
from app.problems import DEADLINE, ProblemError
from app.runtime import Runtime
from app.settings import Settings
from app.uploads import read_upload
from model.formats import SUPPORTED_FORMATS

_DOCS_PAGE = Path(__file__).parent / "static" / "docs.html"
# Everything the page needs is served from here; the policy keeps it so.
_DOCS_HEADERS = {
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; style-src 'self' 'unsafe-inline'"
}

router = APIRouter()


def _runtime(request: Request) -> Runtime:
    return cast(Runtime, request.app.state.runtime)


RuntimeOf = Annotated[Runtime, Depends(_runtime)]


async def _detect(request: Request, runtime: Runtime, options: Options) -> bytes:
    settings = runtime.settings
    detector = runtime.detector
    limits = MeshLimits(settings.max_vertices, settings.max_faces)
    with runtime.pool.admit() as place:
        upload = await read_upload(request, settings.max_upload_bytes)

        def work() -> bytes:
            response = parse_and_detect(detector, upload.data, upload.filename, options, limits)
            return to_json(response, options.include)

        return await place.run(request, work)


@router.post("/detect", **openapi.DETECT)
async def detect(request: Request, query: Annotated[schemas.DetectQuery, Query()], runtime: RuntimeOf) -> Response:
    """Find the mirror planes and rotation axes of one mesh, in the file's own coordinates."""
    options = Options(query.mode, query.max_error, frozenset(query.include))
    seconds = runtime.settings.deadline_s
    try:
        async with asyncio.timeout(seconds):
            return Response(await _detect(request, runtime, options), media_type="application/json")
    except TimeoutError as error:
        raise ProblemError(DEADLINE, f"The request took longer than the {seconds:g} seconds allowed.") from error


@router.get("/health", **openapi.HEALTH)
async def health(runtime: RuntimeOf) -> schemas.Health:
    """200 when a request would be served; 503 while weights are loaded and while the service shuts down."""
    runtime.require_ready()
    return schemas.Health(status="ready")


@router.get("/health/live", **openapi.LIVE)
async def live() -> schemas.Health:
    """200 as long as the process answers at all."""
    return schemas.Health(status="alive")


@router.get("/model", **openapi.MODEL)
async def model_card(runtime: RuntimeOf) -> schemas.ModelCard:
    """The model card of the served weights, and the limits of a request."""
    detector = runtime.detector
    return schemas.ModelCard(
        name=detector.name,
        version=detector.version,
        sha256=detector.sha256,
        service_version=__version__,
        metadata=dict(detector.metadata),
        limits=_limits(runtime.settings),
    )


def _limits(settings: Settings) -> schemas.Limits:
    return schemas.Limits(
        max_upload_bytes=settings.max_upload_bytes,
        max_vertices=settings.max_vertices,
        max_faces=settings.max_faces,
        deadline_s=settings.deadline_s,
        formats=list(SUPPORTED_FORMATS),
    )


@router.get("/", include_in_schema=False)
async def home() -> Response:
    """The documentation stands in for a home page."""
    return RedirectResponse("docs")


@router.get("/docs", include_in_schema=False)
async def docs() -> Response:
    """Swagger UI, from files of this package: nothing is fetched from elsewhere."""
    return FileResponse(_DOCS_PAGE, headers=_DOCS_HEADERS)
