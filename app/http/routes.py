"""The endpoints. They check, wait and answer; parsing and computing happen in worker processes."""

from typing import Annotated, cast

from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import Response

from app import __version__, queries, schemas
from app.http import answers, openapi
from app.http.auth import require_key
from app.http.handler import Outcome, process_upload
from app.http.metrics import CONTENT_TYPE
from app.http.runtime import Runtime

router = APIRouter()
metrics_router = APIRouter()
KEY = [Depends(require_key)]


async def _runtime(request: Request) -> Runtime:  # in the event loop: a thread to run it in takes half a millisecond
    return cast(Runtime, request.app.state.runtime)


RuntimeOf = Annotated[Runtime, Depends(_runtime)]


@router.post("/detect", dependencies=KEY, **openapi.DETECT)
async def detect(request: Request, query: Annotated[queries.DetectQuery, Query()], runtime: RuntimeOf) -> Response:
    """Find the mirror planes and rotation axes of one mesh, in the file's own coordinates."""
    choice = answers.wanted_format(query, request.headers.get("accept"))
    include = list(dict.fromkeys([*query.include, *choice.output.include]))
    geometry = choice.output.name if choice.output.mesh is not None else None
    outcome = await process_upload(
        request,
        runtime,
        f"{choice.output.name} {choice.media_type} {sorted(query.include)}",
        task="detect",
        mode=query.mode,
        max_error=query.max_error,
        include=include,
        geometry=geometry,
        level=query.level,
        tolerance=query.tolerance,
    )
    if outcome.answer is None:
        return answers.not_modified(outcome.headers)
    return answers.with_headers(answers.detected(runtime, outcome.answer, query, choice), outcome.headers)


def _mesh(runtime: Runtime, outcome: Outcome, format: str) -> Response:
    if outcome.answer is None:
        return answers.not_modified(outcome.headers)
    return answers.with_headers(answers.edited(runtime, outcome.answer, format), outcome.headers)


@router.post("/complete", dependencies=KEY, **openapi.COMPLETE)
async def complete(request: Request, query: Annotated[queries.CompleteQuery, Query()], runtime: RuntimeOf) -> Response:
    """Complete one mesh by its mirror image: what is there stays, what is missing is taken from the other side."""
    outcome = await process_upload(
        request,
        runtime,
        query.format,
        task="complete",
        mode="full",
        max_error=query.max_error,
        include=[],
        geometry=query.format,
        plane=query.plane,
        symmetrize=query.symmetrize,
    )
    return _mesh(runtime, outcome, query.format)


@router.post("/halve", dependencies=KEY, **openapi.HALVE)
async def halve(request: Request, query: Annotated[queries.HalveQuery, Query()], runtime: RuntimeOf) -> Response:
    """Keep one half of one mesh, cut exactly at a plane, open there or closed."""
    outcome = await process_upload(
        request,
        runtime,
        query.format,
        task="halve",
        mode="full",
        max_error=query.max_error,
        include=[],
        geometry=query.format,
        plane=query.plane,
        positive=not query.other,
        capped=query.capped,
    )
    return _mesh(runtime, outcome, query.format)


@router.post("/sector", dependencies=KEY, **openapi.SECTOR)
async def sector(request: Request, query: Annotated[queries.SectorQuery, Query()], runtime: RuntimeOf) -> Response:
    """Cut one of n equal sectors out of one mesh, between two planes through a rotation axis."""
    outcome = await process_upload(
        request,
        runtime,
        query.format,
        task="sector",
        mode="full",
        max_error=query.max_error,
        include=[],
        geometry=query.format,
        line=query.line,
        order=query.order,
        start=query.way,
        capped=query.capped,
    )
    return _mesh(runtime, outcome, query.format)


@router.post("/align", dependencies=KEY, **openapi.ALIGN)
async def align(request: Request, query: Annotated[queries.AlignQuery, Query()], runtime: RuntimeOf) -> Response:
    """Lay a copy of one mesh along the axes: its symmetry plane on YZ, its main axis on Z."""
    outcome = await process_upload(
        request,
        runtime,
        query.format,
        task="align",
        mode="full",
        max_error=query.max_error,
        include=[],
        geometry=query.format,
    )
    return _mesh(runtime, outcome, query.format)


@router.get("/health", **openapi.HEALTH)
async def health(runtime: RuntimeOf) -> schemas.Health:
    """200 when a request would be served; 503 while weights are loaded and while the service shuts down."""
    runtime.require_ready()
    return schemas.Health(status="ready")


@router.get("/health/live", **openapi.LIVE)
async def live() -> schemas.Health:
    """200 as long as the process answers at all."""
    return schemas.Health(status="alive")


@router.get("/model", dependencies=KEY, **openapi.MODEL)
async def model_card(runtime: RuntimeOf) -> schemas.ModelCard:
    """The model card of the served weights, and the limits of a request."""
    card, settings = runtime.card, runtime.settings
    return schemas.ModelCard(
        name=card.name,
        version=card.version,
        sha256=card.sha256,
        service_version=__version__,
        metadata=card.metadata,
        limits=schemas.Limits(
            max_upload_bytes=settings.max_upload_bytes,
            max_vertices=settings.max_vertices,
            max_faces=settings.max_faces,
            max_nodes=settings.max_nodes,
            max_unpacked_bytes=settings.max_unpacked_bytes,
            memory_bytes=settings.worker_memory_bytes,
            upload_s=settings.upload_s,
            stall_s=settings.stall_s,
            parse_s=settings.parse_s,
            deadline_s=settings.deadline_s,
            max_answer_bytes=settings.max_answer_bytes,
            formats=card.formats,
        ),
    )


@metrics_router.get("/metrics", dependencies=KEY, **openapi.METRICS)
async def metrics(runtime: RuntimeOf) -> Response:
    """Counters, gauges and histograms for Prometheus."""
    return Response(runtime.metrics.text(), headers={"Content-Type": CONTENT_TYPE})
