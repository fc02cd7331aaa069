"""Puts the application together."""

import logging
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from pathlib import Path

from fastapi import FastAPI
from fastapi.staticfiles import StaticFiles

from app import __version__, openapi, problems, routes
from app.detection import SymmetryDetector
from app.middleware import RequestContext
from app.runtime import Runtime
from app.settings import Settings

STATIC = Path(__file__).parent / "static"
logger = logging.getLogger("prsnet")


def create_app(settings: Settings | None = None, detector: SymmetryDetector | None = None) -> FastAPI:
    """The application; without arguments configured by the environment, with the shipped weights.

    A ``detector`` given here is served instead of loading ``settings.weights``.
    """
    runtime = Runtime(settings or Settings(), detector)

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncGenerator[None, None]:
        logger.info("settings: %s", runtime.settings.summary())
        runtime.start()
        yield
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
