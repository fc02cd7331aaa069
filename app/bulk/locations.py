"""Where meshes come from and results go to: folders, patterns and files, here or in an object store.

A location is a path or a URI. ``file://``, ``s3://``, ``gs://``, ``abfs://`` and ``hdfs://`` are opened by pyarrow,
every other scheme by whatever fsspec knows for it. What a URI says after ``?`` is for the file system
(``s3://bucket/meshes?region=eu-central-1``); so are credentials in the environment.
"""

import re
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any
from urllib.parse import quote

from app.bulk.libraries import filesystems, fsspec, pa
from model.formats import SOUGHT

MESHES = tuple(f".{name}" for name in sorted(SOUGHT))
SHARDS = (".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tar.xz")
_MAGIC = re.compile(r"[*?\[]")
_SCHEME = re.compile(r"([a-zA-Z][a-zA-Z0-9+.-]+)://")


class LocationError(Exception):
    """A location that cannot be used; the message says why."""


@dataclass(frozen=True, slots=True)
class Input:
    """A mesh file or a shard: ``path`` as the table names it, its size in bytes."""

    path: str
    size: int

    @property
    def is_shard(self) -> bool:
        """Whether it is a tar file of meshes."""
        return self.path.lower().endswith(SHARDS)


class Store:
    """A file system, and how a path in it is named outside of it."""

    def __init__(self, location: str) -> None:
        """Open what ``location`` names.

        Raises:
            LocationError: there is no such file system, or it cannot be reached.
        """
        try:
            self.filesystem, self.root, self._prefix = _open(location)
        except (OSError, ValueError, ImportError) as error:
            raise LocationError(f"{location.partition('?')[0]}: {error}") from error
        self.root = self.root.rstrip("/") or "/"
        self.location = location if self._prefix else self.root
        """The same in every working directory."""

    @property
    def replaces_at_once(self) -> bool:
        """Whether a file that is written appears whole or not at all, as in an object store."""
        return self.filesystem.type_name in ("s3", "gcs", "abfs")

    def name(self, path: str) -> str:
        """What the table calls a path of this file system."""
        return self._prefix + path

    def inside(self, name: str) -> str:
        """The path of this file system that the table calls ``name``."""
        return name.removeprefix(self._prefix)

    @contextmanager
    def reading(self, name: str) -> Generator[IO[bytes]]:
        """The file that the table calls ``name``, open.

        Raises:
            OSError: it cannot be read.
        """
        with self.filesystem.open_input_stream(self.inside(name), compression=None) as stream:
            yield stream

    def write(self, path: str, data: Any) -> None:
        """Write a file below the location, in such a way that it is never there in part.

        Raises:
            OSError: it cannot be written.
        """
        target = f"{self.root}/{path}"
        written = target if self.replaces_at_once else f"{self.root}/_unfinished-{path}"
        self._put(written, data)
        if written != target:
            self.filesystem.move(written, target)

    def _put(self, path: str, data: Any) -> None:
        with self.filesystem.open_output_stream(path, compression=None) as stream:
            stream.write(data)

    def list_inputs(self) -> list[Input]:
        """Every mesh and every shard that the location stands for, each once, sorted.

        A file that is named is taken whatever its name; of folders and patterns what is a mesh or a shard.

        Raises:
            LocationError: there is nothing.
        """
        root = self.root
        try:
            if _MAGIC.search(root):
                found = self._matching(root)
            else:
                info = self.filesystem.get_file_info(root)
                if info.type == filesystems.FileType.File:
                    return [Input(self.name(root), info.size)]
                if info.type == filesystems.FileType.NotFound:
                    raise LocationError(f"{self.name(root)}: there is nothing of this name")
                found = self._below(root)
        except OSError as error:
            raise LocationError(f"{self.name(root)}: {error}") from error
        inputs = [Input(self.name(path), size) for path, size in found if path.lower().endswith(MESHES + SHARDS)]
        if not inputs:
            raise LocationError(f"{self.name(root)}: there are no meshes and no shards")
        return sorted(inputs, key=lambda item: item.path)

    def _below(self, folder: str, missing_ok: bool = False) -> Iterator[tuple[str, int]]:
        selector = filesystems.FileSelector(folder, recursive=True, allow_not_found=missing_ok)
        for info in self.filesystem.get_file_info(selector):
            if info.type == filesystems.FileType.File:
                yield info.path, info.size

    def _matching(self, pattern: str) -> Iterator[tuple[str, int]]:
        matches = re.compile(str(fsspec("utils").glob_translate(pattern))).match
        folder = _MAGIC.split(pattern, maxsplit=1)[0].rpartition("/")[0] or "/"
        return ((path, size) for path, size in self._below(folder, missing_ok=True) if matches(path))


def _open(location: str) -> tuple[Any, str, str]:
    """The file system, the location's path in it, and what stands before such a path outside of it."""
    match = _SCHEME.match(location)
    scheme = match[1] if match else "file"
    if scheme == "file":
        path = Path(location.removeprefix("file://")).expanduser().absolute()
        return filesystems.LocalFileSystem(), path.as_posix(), ""
    address, _, query = location.partition("?")
    host, slash, path = address.partition("://")[2].partition("/")
    # patterns and spaces cannot stand in a URI as they are
    uri = f"{scheme}://{host}{slash}{quote(path)}" + (f"?{query}" if query else "")
    try:
        filesystem, inside = filesystems.FileSystem.from_uri(uri)
    except (ValueError, pa.ArrowException):
        return _open_with_fsspec(scheme, address)
    return filesystem, inside, f"{scheme}://{host}" if inside.startswith("/") else f"{scheme}://"


def _open_with_fsspec(scheme: str, address: str) -> tuple[Any, str, str]:
    filesystem, inside = fsspec("core").url_to_fs(address)
    return filesystems.PyFileSystem(filesystems.FSSpecHandler(filesystem)), str(inside), f"{scheme}://"
