"""What an actor does: read files, have them worked on by hardened worker processes, write a row for each.

The actor itself never parses a mesh: as in the HTTP service that is done by processes without files or connections,
with limits on memory and time, which are killed and replaced when a file does harm (see ``app.workers``).
"""

import asyncio
import hashlib
import logging
import threading
import time
from collections.abc import Awaitable, Callable, Coroutine, Iterator
from dataclasses import dataclass
from pathlib import PurePosixPath
from typing import Any, TypeVar

from app.bulk import columns
from app.bulk.libraries import pa
from app.bulk.locations import Store
from app.bulk.plan import Piece
from app.bulk.results import Part
from app.bulk.shards import SHARD_ERRORS, Member, members
from app.problems import (
    DEADLINE,
    INTERNAL,
    MESH_TOO_LARGE,
    TOO_MUCH_MEMORY,
    UPLOAD_TOO_LARGE,
    WORKER_LOST,
    for_mesh_error,
)
from app.schemas import DetectResponse, LevelName, Mode
from app.settings import Settings
from app.workers.errors import DefectError, OutOfMemoryError, TookTooLongError, WorkerLostError
from app.workers.pool import WorkerPool
from app.workers.wire import Job
from app.workers.zygote_client import launcher
from model.errors import MeshError

logger = logging.getLogger("prsnet")
T = TypeVar("T")

NOT_READ = "not-read"
"""The problem of a file that could not be opened or read to its end."""
UNREADABLE_SHARD = "unreadable-shard"
"""The problem of a row that stands for what could not be read of a shard."""


@dataclass(frozen=True, slots=True)
class Task:
    """What to do with every mesh: where from, where to, and the settings of the workers, by name."""

    source: str
    target: str
    mode: Mode
    max_error: float
    level: LevelName
    tolerance: float | None
    settings: dict[str, Any]


@dataclass(slots=True)
class Counts:
    """How many meshes a piece had, and how many rows have no answer."""

    meshes: int = 0
    problems: int = 0


class BulkDetector:
    """Works on pieces; an actor has one, and calls it from several threads."""

    def __init__(self, task: Task) -> None:
        """Start the workers.

        Raises:
            app.workers.zygote_client.StartError: they do not start.
            app.bulk.locations.LocationError: the files cannot be reached from this machine.
        """
        self._task = task
        self._settings = Settings(**task.settings)
        self._source, self._target = Store(task.source), Store(task.target)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="workers", daemon=True)
        self._thread.start()
        self._pool = WorkerPool(self._settings, launcher(self._settings.weights))
        self._wait_for(self._pool.start())

    def __call__(self, batch: Any) -> Any:
        """Work on the pieces in an Arrow table, write their rows, and tell how many meshes and problems there were."""
        told = [self.work(Piece(**piece)) for piece in batch.to_pylist()]
        return pa.Table.from_pylist(told)

    def work(self, piece: Piece) -> dict[str, int]:
        """Work on one piece: when this returns, its rows are in the output."""
        part = Part(self._target, "\n".join(piece.paths))
        counts = self._wait_for(self._shard(piece, part) if piece.shard else self._files(piece, part))
        part.finish()
        return {"meshes": counts.meshes, "problems": counts.problems, "cost": piece.cost}

    def close(self) -> None:
        """End the workers."""
        self._wait_for(self._pool.close())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def _wait_for(self, work: Coroutine[Any, Any, T]) -> T:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result()

    async def _files(self, piece: Piece, part: Part) -> Counts:
        files = iter(zip(piece.paths, piece.sizes, strict=True))

        async def following() -> tuple[str, int] | None:
            return next(files, None)

        return await self._in_lanes(following, lambda item: self._file(*item), part)

    async def _shard(self, piece: Piece, part: Part) -> Counts:
        (shard,) = piece.paths
        reader = _ShardReader(self._source, shard, self._settings.max_upload_bytes)
        reading = asyncio.Lock()

        async def following() -> Member | None:
            async with reading:
                return await asyncio.to_thread(reader.next)

        counts = await self._in_lanes(following, lambda item: self._member(shard, item), part)
        if reader.problem or not counts.meshes:
            row = {"path": shard, "shard": shard, "bytes": piece.sizes[0], "problem": UNREADABLE_SHARD}
            part.add(row | {"detail": reader.problem or "There are no meshes in the shard."})
            counts.problems += 1
        return counts

    async def _in_lanes(
        self, following: Callable[[], Awaitable[T | None]], row_of: Callable[[T], Awaitable[dict[str, Any]]], part: Part
    ) -> Counts:
        """Rows of all items, a few at a time: while the workers compute, the next file is read."""
        counts = Counts()

        async def lane() -> None:
            while (item := await following()) is not None:
                row = await row_of(item)
                part.add(row)
                counts.meshes += 1
                counts.problems += row.get("problem") is not None

        await asyncio.gather(*[lane() for _ in range(self._settings.workers + 1)])
        return counts

    async def _file(self, path: str, size: int) -> dict[str, Any]:
        row: dict[str, Any] = {"path": path, "bytes": size}
        if size > self._settings.max_upload_bytes:
            return row | self._too_large()
        began = time.perf_counter()
        try:
            data = await asyncio.to_thread(self._read, path)
        except OSError as error:
            return row | {"problem": NOT_READ, "detail": error.strerror or str(error)}
        row |= {"bytes": len(data), "read_ms": (time.perf_counter() - began) * 1e3}
        if len(data) > self._settings.max_upload_bytes:
            return row | self._too_large()
        return row | await self._detect(path, data)

    async def _member(self, shard: str, member: Member) -> dict[str, Any]:
        row: dict[str, Any] = {"path": f"{shard}/{member.name}", "shard": shard, "bytes": member.size}
        if member.data is None:
            return row | self._too_large()
        return row | await self._detect(member.name.partition("#")[0], member.data)

    def _read(self, path: str) -> bytes:
        with self._source.reading(path) as stream:
            # one byte more than it may have: it may have grown since it was listed
            return stream.read(self._settings.max_upload_bytes + 1)

    def _too_large(self) -> dict[str, Any]:
        most = self._settings.max_upload_bytes
        return {"problem": UPLOAD_TOO_LARGE.slug, "detail": f"The file is larger than the limit of {most} bytes."}

    async def _detect(self, path: str, data: bytes) -> dict[str, Any]:
        """The columns that a file's content decides."""
        name = PurePosixPath(path).name
        row: dict[str, Any] = {"sha256": hashlib.sha256(data).hexdigest()}
        began = [time.perf_counter()]
        try:
            answer = await self._run(self._job(f"mesh{PurePosixPath(name).suffix}", len(data)), data, began)
            row |= columns.answered(answer)
            row["mesh"]["filename"] = name
        except MeshError as error:
            row |= {"problem": for_mesh_error(error).slug, "detail": str(error)}
        except TookTooLongError as error:
            row |= {"problem": DEADLINE.slug, "detail": str(error)}
        except OutOfMemoryError:
            row |= {"problem": MESH_TOO_LARGE.slug, "detail": TOO_MUCH_MEMORY}
        except WorkerLostError:
            row |= {
                "problem": WORKER_LOST.slug,
                "detail": "The process that worked on the file died, and so did the next.",
            }
        except DefectError as error:
            logger.error("%s: %s", path, error)
            row |= {
                "problem": INTERNAL.slug,
                "detail": "This is a defect of prsnet; the actor's log has the traceback.",
            }
        return row | {"worker_ms": (time.perf_counter() - began[0]) * 1e3}

    async def _run(self, job: Job, data: bytes, began: list[float]) -> DetectResponse:
        seconds = self._settings.deadline_s
        try:
            async with asyncio.timeout(None) as deadline:

                def begin() -> None:  # waiting for a worker is not the file's fault
                    began[0] = time.perf_counter()
                    deadline.reschedule(self._loop.time() + seconds)

                answer = (await self._pool.run(job, data, begin)).content
        except TimeoutError as error:
            raise TookTooLongError(f"The file took longer than the {seconds:g} seconds allowed.") from error
        assert isinstance(answer, DetectResponse)
        return answer

    def _job(self, filename: str, size: int) -> Job:
        settings = self._settings
        return Job(
            filename=filename,
            mode=self._task.mode,
            max_error=self._task.max_error,
            level=self._task.level,
            tolerance=self._task.tolerance,
            include=[],
            max_vertices=settings.max_vertices,
            max_faces=settings.max_faces,
            max_nodes=settings.max_nodes,
            max_unpacked_bytes=settings.max_unpacked_bytes,
            cpu_s=settings.deadline_s,
            size=size,
            transport="inline",
        )


class _ShardReader:
    """The members of a shard, one a call; after the last, or where the shard is damaged, None."""

    def __init__(self, store: Store, shard: str, most_bytes: int) -> None:
        self.problem = ""
        self._members = self._read(store, shard, most_bytes)

    def next(self) -> Member | None:
        """The next member."""
        return next(self._members, None)

    def _read(self, store: Store, shard: str, most_bytes: int) -> Iterator[Member]:
        try:
            with store.reading(shard) as stream:
                yield from members(stream, most_bytes)
        except SHARD_ERRORS as error:
            self.problem = f"The shard cannot be read from here on: {error}."
