"""One request about a mesh, from its first byte to the answer: who waits for what, and what ends it."""

import asyncio
import time
from collections.abc import Coroutine
from dataclasses import dataclass, field
from typing import Any, TypeVar

from fastapi import Request
from starlette.requests import ClientDisconnect

from app import __version__, edit_schemas
from app.http import answer_cache
from app.http.middleware import stages
from app.http.runtime import Runtime
from app.http.spool import Upload
from app.http.uploads import read_upload
from app.problems import DEADLINE, MESH_TOO_LARGE, OVERLOADED, TOO_MUCH_MEMORY, UPLOADS_FULL, WORKER_LOST, ProblemError
from app.workers.errors import OutOfMemoryError, TookTooLongError, WorkerLostError
from app.workers.verify import Answer
from app.workers.wire import Job

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a request: an answer, or none where the client has it already; and headers about that."""

    answer: Answer | None
    headers: dict[str, str] = field(default_factory=dict[str, str])


async def process_upload(request: Request, runtime: Runtime, variant: str, **wanted: Any) -> Outcome:
    """Read the mesh of a request, and have it worked on, or find the answer that was given before.

    ``variant`` is what, beside the answer itself, makes one response different from another; ``wanted`` are members of
    `Job`.

    Raises:
        ProblemError: there is no answer, and why.
        model.errors.MeshError: the mesh is to blame.
        ClientDisconnect: nobody is left to answer.
    """
    seconds = runtime.settings.deadline_s
    try:
        async with asyncio.timeout(seconds):
            return await _process(request, runtime, variant, wanted)
    except TimeoutError as error:
        raise ProblemError(DEADLINE, f"The request took longer than the {seconds:g} seconds allowed.") from error
    except TookTooLongError as error:
        raise ProblemError(DEADLINE, str(error)) from error
    except OutOfMemoryError as error:
        raise ProblemError(MESH_TOO_LARGE, TOO_MUCH_MEMORY) from error
    except WorkerLostError as error:
        raise ProblemError(WORKER_LOST, WORKER_LOST.example, {"Retry-After": "1"}) from error
    finally:
        _arrived(request)


def _arrived(request: Request) -> None:
    """The request need not be counted as one that will come any more."""
    if "arrival" in request.scope:
        request.scope["arrival"].end()


async def _process(request: Request, runtime: Runtime, variant: str, wanted: dict[str, Any]) -> Outcome:
    settings = runtime.settings
    _ = runtime.card  # refused with not-ready before anything is read, and a full queue likewise
    peer = request.client.host if request.client is not None else ""
    runtime.pool.require_room(runtime.gate.client(request.headers.raw, peer))
    slot = runtime.gate.slots.take(runtime.gate.address(request.headers.raw, peer))
    if slot is None:
        raise ProblemError(OVERLOADED, UPLOADS_FULL.example, {"Retry-After": "1"})
    spent = stages(request)
    began = time.perf_counter()
    try:
        upload = await read_upload(request, settings, slot)
    finally:
        runtime.gate.slots.leave(slot)
        spent["upload"] = _since(began)
    with upload:
        job = _job(runtime, upload, wanted)
        if not runtime.cache.enabled:
            return Outcome(await _computed(request, runtime, upload, job, peer))
        return await _cached(request, runtime, upload, job, peer, variant)


def _job(runtime: Runtime, upload: Upload, wanted: dict[str, Any]) -> Job:
    settings = runtime.settings
    return Job(
        filename=upload.filename,
        max_vertices=settings.max_vertices,
        max_faces=settings.max_faces,
        max_nodes=settings.max_nodes,
        max_unpacked_bytes=settings.max_unpacked_bytes,
        max_answer_bytes=settings.max_answer_bytes,
        cpu_s=settings.deadline_s,
        size=upload.size,
        parts=[list(part) for part in upload.parts],
        transport="inline" if upload.descriptor is None else "descriptor",
        **wanted,
    )


async def _cached(request: Request, runtime: Runtime, upload: Upload, job: Job, peer: str, variant: str) -> Outcome:
    """The answer that was kept, or a new one, which is kept."""
    question = answer_cache.digest(upload.digest, job.members, __version__, runtime.card.sha256)
    # Weak: the milliseconds in two answers to one question differ.
    etag = f'W/"{answer_cache.digest(question, variant)[:32]}"'
    if answer_cache.matches(etag, request.headers.get("if-none-match")):
        _arrived(request)
        return Outcome(None, {"ETag": etag})
    key = answer_cache.digest(question, runtime.gate.owner(request.headers.raw, peer))
    if (answer := runtime.cache.get(key)) is not None:
        _arrived(request)
        return Outcome(answer, {"ETag": etag, answer_cache.HEADER: "hit"})
    answer = await _computed(request, runtime, upload, job, peer)
    runtime.cache.put(key, answer)
    return Outcome(answer, {"ETag": etag, answer_cache.HEADER: "miss"})


async def _computed(request: Request, runtime: Runtime, upload: Upload, job: Job, peer: str) -> Answer:
    client = runtime.gate.client(request.headers.raw, peer)
    spent = stages(request)
    began = time.perf_counter()

    def begin() -> None:
        spent["queue"] = _since(began)

    with runtime.pool.admit(client):
        _arrived(request)
        result = await _unless_gone(request, runtime.pool.run(job, upload.source, begin, client))
    timings = result.content.timings_ms
    for name in ("parse", "voxelize", "infer", "refine"):
        spent[name] = getattr(timings, name)
    spent["validate"] = timings.validate_
    if isinstance(result.content, edit_schemas.CompletedMesh):
        spent["complete"] = result.content.complete_ms
    spent["worker"] = timings.total
    return result


def _since(began: float) -> float:
    return (time.perf_counter() - began) * 1e3


async def _unless_gone(request: Request, work: Coroutine[Any, Any, T]) -> T:
    """The result of ``work``, which is cancelled when the client leaves.

    Raises:
        ClientDisconnect: it did.
    """
    result = asyncio.create_task(work)
    gone = asyncio.create_task(_disconnected(request))
    try:
        await asyncio.wait({result, gone}, return_when=asyncio.FIRST_COMPLETED)
        if not result.done():
            raise ClientDisconnect
        return result.result()
    finally:
        if not result.done():
            result.cancel("client-left" if gone.done() and not gone.cancelled() else "deadline")
            await asyncio.wait({result})  # it kills its worker
        gone.cancel()


async def _disconnected(request: Request) -> None:
    while (await request.receive())["type"] != "http.disconnect":
        pass
