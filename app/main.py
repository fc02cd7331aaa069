"""Puts the application together."""

import logging
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path

from fastapi import FastAPI
from fastapi.staticfiles import StaticFiles

from app import __version__, openapi, problems, routes
from app.middleware import RequestContext
from app.runtime import Runtime
from app.settings import Settings
from app.workers.factory import Launch

STATIC = Path(__file__).parent / "static"
logger = logging.getLogger("prsnet")


def create_app(settings: Settings | None = None, launch: Launch | None = None) -> FastAPI:
    """The application; without arguments configured by the environment, with the shipped weights.

    ``launch`` starts the process that workers are forked from, instead of one that loads ``settings.weights``.
    """
    runtime = Runtime(settings or Settings(), launch)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncGenerator[None, None]:
        logger.info("settings: %s", runtime.settings.summary())
        runtime.start()
        try:
            yield
        finally:
            await runtime.stop()

    app = FastAPI(
        title=openapi.TITLE,
        version=__version__,
        summary=openapi.SUMMARY,
        description=openapi.DESCRIPTION,
        docs_url=None,
        redoc_url=None,
        lifespan=lifespan,
    )
    app.state.runtime = runtime
    app.add_middleware(RequestContext)
    problems.install(app)
    app.include_router(routes.router)
    app.mount("/static", StaticFiles(directory=STATIC), name="static")
    openapi.install(app)
    return app
