"""Assembles the application."""

import logging
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager

from fastapi import FastAPI
from fastapi.middleware.cors import CORSMiddleware

from app import __version__, edit_schemas, problems
from app.http import answer_cache, auth, openapi, pages, routes, tracing
from app.http.middleware import HEADER, RequestContext
from app.http.runtime import Runtime
from app.settings import Settings, settings_of_environment
from app.workers.zygote_client import Launch

logger = logging.getLogger("prsnet")


def create_app(settings: Settings | None = None, launch: Launch | None = None) -> FastAPI:
    """The application; without arguments configured by the environment, with the shipped weights.

    ``launch`` starts the process that workers are forked from, instead of one that loads ``settings.weights``.
    """
    settings = settings or settings_of_environment()
    runtime = Runtime(settings, launch)
    trace, end_traces = tracing.tracer() if settings.otel else (None, lambda: None)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncGenerator[None, None]:
        logger.info("settings: %s", settings.summary())
        runtime.start()
        try:
            yield
        finally:
            await runtime.stop()
            end_traces()

    app = FastAPI(
        title=openapi.TITLE,
        version=__version__,
        summary=openapi.SUMMARY,
        description=openapi.DESCRIPTION,
        docs_url=None,
        openapi_url="/openapi.json" if settings.docs else None,
        redoc_url=None,
        lifespan=lifespan,
    )
    app.state.runtime = runtime
    if origins := list(filter(None, settings.cors_origins.replace(" ", "").split(","))):
        app.add_middleware(
            CORSMiddleware,
            allow_origins=origins,
            allow_methods=["GET", "POST"],
            allow_headers=[auth.HEADER, "Authorization", "If-None-Match", HEADER],
            expose_headers=[
                HEADER,
                answer_cache.HEADER,
                edit_schemas.COMPLETION,
                "Content-Disposition",
                "ETag",
                "Server-Timing",
                "Retry-After",
            ],
        )
    app.add_middleware(RequestContext, metrics=runtime.metrics, trace=trace)
    problems.install(app)
    app.include_router(routes.router)
    if settings.metrics:
        app.include_router(routes.metrics_router)
    pages.install(app, viewer=settings.viewer, docs=settings.docs)
    openapi.install(app)
    return app
