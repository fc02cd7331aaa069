"""A client of the service: typed results, errors as exceptions, retries that wait as long as the service asks.

>>> with Client("http://127.0.0.1:8000") as client:
...     client.detect("chair.obj").planes[0].matrix

A mesh is a path, a ``trimesh`` object, ``(vertices, faces)``, a file name and its bytes, or several files by name of
which one is a mesh. Files are streamed from disk; those that a .gltf file refers to go with it. Every call can be
repeated without harm, so it is: when the service is overloaded or starting, and when the
connection breaks before an answer came.
"""

import asyncio
import time
from collections.abc import Collection, Sequence
from types import TracebackType
from typing import Self

import httpx

from app.client.calls import (
    AlignedFile,
    Call,
    ClientConfig,
    CompletedFile,
    HalfFile,
    SectorFile,
    Source,
    align_call,
    aligned,
    checked,
    complete_call,
    completed,
    cut,
    detect_call,
    halve_call,
    halved,
    parsed,
    pause,
    sector_call,
)
from app.planes import PlaneLike
from app.schemas import DetectResponse, Include, LevelName, Mode, ModelCard

DEFAULT_URL = "http://127.0.0.1:8000"
TIMEOUT = httpx.Timeout(90.0, connect=5.0)
"""Seconds without a byte either way; the service's own deadline is 60 unless it is configured otherwise."""


class Client:
    """The synchronous client; several threads may share it.

    Args:
        url: where the service is.
        api_key: a key, where the operator asks for one.
        timeout: seconds, or an ``httpx.Timeout``.
        retries: how often a request is made again.
        transport: an ``httpx`` transport, for tests and proxies.

    All methods raise `app.client.errors.ClientError`; and ``OSError`` or ``model.MeshError`` where the mesh to be sent
    is at fault before anything is sent.
    """

    def __init__(
        self,
        url: str = DEFAULT_URL,
        *,
        api_key: str | None = None,
        timeout: httpx.Timeout | float = TIMEOUT,
        retries: int = 4,
        transport: httpx.BaseTransport | None = None,
    ) -> None:
        self._config = ClientConfig(url, api_key, timeout, retries, transport)
        self._http = httpx.Client(**self._config.arguments)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def detect(
        self,
        mesh: Source,
        *,
        mode: Mode = "full",
        max_error: float = 4e-4,
        level: LevelName = "auto",
        tolerance: float | None = None,
        include: Collection[Include] = (),
    ) -> DetectResponse:
        """The symmetries of a mesh; see `app.local.detect`."""
        return parsed(
            DetectResponse, self._send(detect_call(mesh, mode, max_error, include, None, level, tolerance)).content
        )

    def export(
        self,
        mesh: Source,
        format: str,
        *,
        mode: Mode = "full",
        max_error: float = 4e-4,
        level: LevelName = "auto",
        tolerance: float | None = None,
    ) -> bytes:
        """The symmetries of a mesh as a file: an annotated ``glb``, a ``bop`` entry, ``shrec`` text, ``csv``."""
        return self._send(detect_call(mesh, mode, max_error, (), format, level, tolerance)).content

    def complete(
        self,
        mesh: Source,
        *,
        format: str = "ply",
        plane: PlaneLike | None = None,
        symmetrize: bool = False,
        max_error: float = 4e-4,
    ) -> CompletedFile:
        """A mesh completed by its mirror image; see `app.local.complete`."""
        return completed(self._send(complete_call(mesh, format, plane, symmetrize, max_error)), format)

    def halve(
        self,
        mesh: Source,
        *,
        format: str = "ply",
        plane: PlaneLike | None = None,
        positive: bool = True,
        capped: bool = False,
        max_error: float = 4e-4,
    ) -> HalfFile:
        """One half of a mesh, open where it was cut or capped; without a plane, at the best one that is detected."""
        return halved(self._send(halve_call(mesh, format, plane, positive, capped, max_error)), format)

    def sector(
        self,
        mesh: Source,
        *,
        format: str = "ply",
        order: int | None = None,
        axis: Sequence[float] | None = None,
        point: Sequence[float] | None = None,
        start: Sequence[float] | None = None,
        capped: bool = True,
        max_error: float = 4e-4,
    ) -> SectorFile:
        """One of n equal sectors of a mesh about an axis; see `app.local.sector`."""
        return cut(self._send(sector_call(mesh, format, order, axis, point, start, capped, max_error)), format)

    def align(self, mesh: Source, *, format: str = "ply", max_error: float = 4e-4) -> AlignedFile:
        """A copy of a mesh laid along the axes; see `app.local.align`."""
        return aligned(self._send(align_call(mesh, format, max_error)), format)

    def model_card(self) -> ModelCard:
        """What the service serves, and the limits of a request."""
        return parsed(ModelCard, self._send(Call("GET", "/model", {})).content)

    def ready(self) -> bool:
        """Whether a request would be served now."""
        try:
            return self._http.get("/health").is_success
        except httpx.TransportError:
            return False

    def _send(self, call: Call) -> httpx.Response:
        for attempt in range(self._config.retries + 1):
            response = None
            with call.arguments() as arguments:
                try:
                    response = self._http.request(call.method, call.path, **arguments)
                except httpx.TransportError as error:
                    if failure := self._config.unreachable(error, attempt):
                        raise failure from error
            if response is not None and self._config.final(response, attempt):
                return checked(response)
            time.sleep(pause(response, attempt))
        raise AssertionError("the last attempt returns or raises")


class AsyncClient:
    """The same with ``async`` and ``await``; arguments and methods are those of `Client`."""

    def __init__(
        self,
        url: str = DEFAULT_URL,
        *,
        api_key: str | None = None,
        timeout: httpx.Timeout | float = TIMEOUT,
        retries: int = 4,
        transport: httpx.AsyncBaseTransport | None = None,
    ) -> None:
        self._config = ClientConfig(url, api_key, timeout, retries, transport)
        self._http = httpx.AsyncClient(**self._config.arguments)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.aclose()

    async def aclose(self) -> None:
        """Close the connections."""
        await self._http.aclose()

    async def detect(
        self,
        mesh: Source,
        *,
        mode: Mode = "full",
        max_error: float = 4e-4,
        level: LevelName = "auto",
        tolerance: float | None = None,
        include: Collection[Include] = (),
    ) -> DetectResponse:
        """The symmetries of a mesh; see `app.local.detect`."""
        return parsed(
            DetectResponse,
            (await self._send(detect_call(mesh, mode, max_error, include, None, level, tolerance))).content,
        )

    async def export(
        self,
        mesh: Source,
        format: str,
        *,
        mode: Mode = "full",
        max_error: float = 4e-4,
        level: LevelName = "auto",
        tolerance: float | None = None,
    ) -> bytes:
        """The symmetries of a mesh as a file: an annotated ``glb``, a ``bop`` entry, ``shrec`` text, ``csv``."""
        return (await self._send(detect_call(mesh, mode, max_error, (), format, level, tolerance))).content

    async def complete(
        self,
        mesh: Source,
        *,
        format: str = "ply",
        plane: PlaneLike | None = None,
        symmetrize: bool = False,
        max_error: float = 4e-4,
    ) -> CompletedFile:
        """A mesh completed by its mirror image; see `app.local.complete`."""
        return completed(await self._send(complete_call(mesh, format, plane, symmetrize, max_error)), format)

    async def halve(
        self,
        mesh: Source,
        *,
        format: str = "ply",
        plane: PlaneLike | None = None,
        positive: bool = True,
        capped: bool = False,
        max_error: float = 4e-4,
    ) -> HalfFile:
        """One half of a mesh, open where it was cut or capped; without a plane, at the best one that is detected."""
        return halved(await self._send(halve_call(mesh, format, plane, positive, capped, max_error)), format)

    async def sector(
        self,
        mesh: Source,
        *,
        format: str = "ply",
        order: int | None = None,
        axis: Sequence[float] | None = None,
        point: Sequence[float] | None = None,
        start: Sequence[float] | None = None,
        capped: bool = True,
        max_error: float = 4e-4,
    ) -> SectorFile:
        """One of n equal sectors of a mesh about an axis; see `app.local.sector`."""
        return cut(await self._send(sector_call(mesh, format, order, axis, point, start, capped, max_error)), format)

    async def align(self, mesh: Source, *, format: str = "ply", max_error: float = 4e-4) -> AlignedFile:
        """A copy of a mesh laid along the axes; see `app.local.align`."""
        return aligned(await self._send(align_call(mesh, format, max_error)), format)

    async def model_card(self) -> ModelCard:
        """What the service serves, and the limits of a request."""
        return parsed(ModelCard, (await self._send(Call("GET", "/model", {}))).content)

    async def ready(self) -> bool:
        """Whether a request would be served now."""
        try:
            return (await self._http.get("/health")).is_success
        except httpx.TransportError:
            return False

    async def _send(self, call: Call) -> httpx.Response:
        for attempt in range(self._config.retries + 1):
            response = None
            with call.arguments() as arguments:
                try:
                    response = await self._http.request(call.method, call.path, **arguments)
                except httpx.TransportError as error:
                    if failure := self._config.unreachable(error, attempt):
                        raise failure from error
            if response is not None and self._config.final(response, attempt):
                return checked(response)
            await asyncio.sleep(pause(response, attempt))
        raise AssertionError("the last attempt returns or raises")
