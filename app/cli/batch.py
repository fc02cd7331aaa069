"""Many files, one after the other or several at a time: what is behind ``prsnet detect``.

A file that cannot be read, or on which a process dies, costs its own answer and no other's.
"""

import functools
import os
from collections.abc import Generator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.client.errors import ClientError, UnreachableError
from app.schemas import DetectResponse, Include, LevelName, Mode
from app.threads import ONE_THREAD

if TYPE_CHECKING:
    from app.client.client import Client
    from app.outputs.png import Up


@dataclass(frozen=True, slots=True)
class Task:
    """What to do with every file; files with the mesh drawn or annotated go to the folders that are named.

    ``names`` are those of files that are to be called something else than their own name without its extension.
    """

    mode: Mode = "full"
    max_error: float = 4e-4
    include: tuple[Include, ...] = ()
    level: LevelName = "auto"
    tolerance: float | None = None
    glb_folder: Path | None = None
    png_folder: Path | None = None
    up: "Up | None" = None
    weights: str = "default"
    url: str | None = None
    api_key: str | None = None
    names: dict[Path, str] = field(default_factory=dict[Path, str])

    def targets(self, path: Path) -> list[Path]:
        """The files that will be written for one."""
        wanted = ((self.glb_folder, ".glb"), (self.png_folder, ".png"))
        return [self._target(path, folder, extension) for folder, extension in wanted if folder is not None]

    def write(self, path: Path, folder: Path, extension: str, data: bytes) -> None:
        """Write what was made of a file; folders on the way are made."""
        place = self._target(path, folder, extension)
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(data)

    def _target(self, path: Path, folder: Path, extension: str) -> Path:
        return folder / f"{self.names.get(path, path.stem)}-symmetries{extension}"


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of one file: an answer, or the reason why there is none; and whether the service was there at all."""

    path: Path
    response: DetectResponse | None
    error: str = ""
    unreachable: bool = False


def run(paths: list[Path], task: Task, jobs: int) -> Generator[Outcome, None, None]:
    """The outcomes, in the order of the files, as they come."""
    if task.url is not None:
        with _client(task) as client, ThreadPoolExecutor(jobs) as threads:
            yield from threads.map(functools.partial(_ask, client, task), paths)
    elif jobs == 1 or len(paths) == 1:
        yield from (work(path, task) for path in paths)
    else:
        yield from _in_processes(paths, task, jobs)


def work(path: Path, task: Task) -> Outcome:
    """Detect, in this process, and write the files that are wanted.

    Raises:
        model.CheckpointError: the weights cannot be used.
    """
    from app.local import detect
    from app.outputs import glb
    from app.outputs.png import picture
    from model.errors import MeshError
    from model.formats.conversion import as_mesh

    try:
        mesh = as_mesh(path, looks=task.glb_folder is not None)
        response = detect(
            mesh,
            mode=task.mode,
            max_error=task.max_error,
            level=task.level,
            tolerance=task.tolerance,
            include=task.include,
            weights=task.weights,
        )
        response = named(response, Path(path.name))
        if task.glb_folder is not None:
            body = glb.WRITER.body(mesh.vertices, mesh.faces, response.mesh.bounds, mesh.colors, mesh.texture)
            task.write(path, task.glb_folder, ".glb", glb.annotated_head(response, body) + body)
        if task.png_folder is not None:
            drawn = picture(response, mesh.vertices, mesh.faces, up=task.up)
            task.write(path, task.png_folder, ".png", drawn)
    except OSError as error:
        return Outcome(path, None, error.strerror or str(error))
    except MeshError as error:
        return Outcome(path, None, str(error))
    except MemoryError:
        return Outcome(path, None, "The mesh needs more memory than there is.")
    return Outcome(path, response)


@contextmanager
def _client(task: Task) -> "Generator[Client, None, None]":
    from app.client.client import Client

    with Client(task.url or "", api_key=task.api_key, retries=8) as client:
        yield client


def _ask(client: "Client", task: Task, path: Path) -> Outcome:
    try:
        options: dict[str, Any] = {
            "mode": task.mode, "max_error": task.max_error, "level": task.level, "tolerance": task.tolerance
        }  # fmt: skip
        response = client.detect(path, include=task.include, **options)
        if task.glb_folder is not None:
            data = client.export(path, "glb", **options)
            task.write(path, task.glb_folder, ".glb", data)
        if task.png_folder is not None:
            from app.outputs.png import picture
            from model.formats.conversion import as_mesh

            mesh = as_mesh(path)
            drawn = picture(response, mesh.vertices, mesh.faces, up=task.up)
            task.write(path, task.png_folder, ".png", drawn)
    except OSError as error:
        return Outcome(path, None, error.strerror or str(error))
    except ClientError as error:
        return Outcome(path, None, str(error), isinstance(error, UnreachableError))
    return Outcome(path, response)


def _in_processes(paths: list[Path], task: Task, jobs: int) -> Generator[Outcome, None, None]:
    with _processes(min(jobs, len(paths))) as pool:
        futures = [pool.submit(work, path, task) for path in paths]
        for path, future in zip(paths, futures, strict=True):
            try:
                yield future.result()
            except BrokenProcessPool:
                # Some file killed its process, and with it the answers of others: each gets one of its own.
                yield _alone(path, task)


def _alone(path: Path, task: Task) -> Outcome:
    with _processes(1) as pool:
        try:
            return pool.submit(work, path, task).result()
        except BrokenProcessPool:
            return Outcome(path, None, "The process that worked on the file died.")


@contextmanager
def _processes(count: int) -> Generator[Executor, None, None]:
    """Processes with one thread for arithmetic each: they are as many as there are cores."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        with ProcessPoolExecutor(count, mp_context=get_context("spawn"), initializer=_start) as pool:
            yield pool
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _start() -> None:
    from model.detector import use_one_thread

    use_one_thread()


def named(response: DetectResponse, path: Path) -> DetectResponse:
    """The answer with a path for its file's name: with several files the last part alone may be ambiguous."""
    return response.model_copy(update={"mesh": response.mesh.model_copy(update={"filename": str(path)})})
