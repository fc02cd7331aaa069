"""The pages for people: the viewer at ``/`` and the API's documentation at ``/docs``, with the files they load.

Everything they need is served from here, and their policies keep it so. Addresses in them are relative, so that the
service may live behind a path prefix.
"""

import html
import json
import os
import re
from pathlib import Path

from fastapi import FastAPI
from fastapi.responses import FileResponse, HTMLResponse, Response
from fastapi.staticfiles import StaticFiles
from starlette.types import Scope

from app.outputs.registry import MESH_WRITERS
from model.formats import FORMATS

STATIC = Path(__file__).parents[1] / "static"

_VIEWER_POLICY = (
    "default-src 'none'; script-src 'self'; worker-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_DOCS_POLICY = "default-src 'self'; img-src 'self' data:; style-src 'self' 'unsafe-inline'"
_FORMATS = "FORMATS"
_LINK_TO_DOCS = re.compile(r'<a [^>]*href="docs"[^>]*>[^<]*</a>')
_HASHED = re.compile(r"-[A-Z0-9]{8}\.(js|css)$")


class _Files(StaticFiles):
    """Files of which those named after their content never change; a browser asks whether others did."""

    def file_response(
        self, full_path: "os.PathLike[str] | str", stat_result: os.stat_result, scope: Scope, status_code: int = 200
    ) -> Response:
        """The file, or 304, with what a cache is to do."""
        response = super().file_response(full_path, stat_result, scope, status_code)
        forever = _HASHED.search(str(full_path))
        response.headers["Cache-Control"] = "public, max-age=31536000, immutable" if forever else "no-cache"
        return response


def install(app: FastAPI, *, viewer: bool, docs: bool) -> None:
    """Add the pages that are wanted."""
    if viewer:
        page = (STATIC / "viewer" / "index.html").read_text(encoding="utf-8")
        page = page.replace(_FORMATS, html.escape(json.dumps(_formats())))
        page = page if docs else _LINK_TO_DOCS.sub("", page)
        headers = {"Content-Security-Policy": _VIEWER_POLICY, "Cache-Control": "no-cache"}

        async def home() -> Response:
            return HTMLResponse(page, headers=headers)

        app.add_api_route("/", home, methods=["GET", "HEAD"], include_in_schema=False)
    if docs:

        async def documentation() -> Response:
            return FileResponse(STATIC / "docs.html", headers={"Content-Security-Policy": _DOCS_POLICY})

        app.add_api_route("/docs", documentation, methods=["GET"], include_in_schema=False)
    if viewer or docs:
        app.mount("/static", _Files(directory=STATIC), name="static")


def _formats() -> dict[str, object]:
    """The formats that are read and written, for the viewer: ``app/viewer/src/formats.ts``."""
    read = [
        {"extension": format.extension, "label": format.label, "note": format.note, "up": format.up}
        for format in FORMATS.values()
    ]
    return {"read": read, "written": list(MESH_WRITERS)}
