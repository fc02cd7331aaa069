"""The folder that results go to: Parquet files that are there whole or not at all, and a note of what they answer.

A file holds the rows of one piece of work and is named after its inputs, so that a piece that is done twice (because a
machine was lost just before it could say that it had finished) replaces its own rows and doubles none.
"""

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from app.bulk import columns
from app.bulk.libraries import dataset, filesystems, pa, parquet
from app.bulk.locations import LocationError, Store

_RUN = "_prsnet.json"
_ROW_GROUP = 256
_SUMMARY = ("path", "shard", "problem", "detail", "point_group", "worker_ms")


class AnotherRunError(Exception):
    """The folder holds answers to another question; the message says which."""


@dataclass(frozen=True, slots=True)
class Done:
    """What has its row: files of their own, and whole shards."""

    files: frozenset[str]
    shards: frozenset[str]


class Part:
    """A result file on its way: rows are compressed as they come, and written at the end in one go."""

    def __init__(self, store: Store, key: str) -> None:
        self._store = store
        self._name = f"part-{hashlib.sha256(key.encode(errors='surrogateescape')).hexdigest()[:32]}.parquet"
        self._buffer = pa.BufferOutputStream()
        self._writer = parquet.ParquetWriter(self._buffer, columns.schema(), compression="zstd")
        self._waiting: list[Mapping[str, Any]] = []

    def add(self, row: Mapping[str, Any]) -> None:
        """One more row."""
        self._waiting.append(row)
        if len(self._waiting) >= _ROW_GROUP:
            self._flush()

    def finish(self) -> None:
        """Write the file.

        Raises:
            OSError: it cannot be written.
        """
        self._flush()
        self._writer.close()
        self._store.write(self._name, self._buffer.getvalue())

    def _flush(self) -> None:
        if self._waiting:
            self._writer.write_table(columns.table(self._waiting))
            self._waiting.clear()


class Results:
    """The result files of a folder."""

    def __init__(self, store: Store) -> None:
        self.store = store

    def claim(self, question: Mapping[str, Any]) -> None:
        """Note what the answers in this folder are to, or make sure that it is the same as before.

        Raises:
            AnotherRunError: it is not.
            LocationError: the folder cannot be used.
        """
        question = {**question, "columns": columns.fingerprint()}
        filesystem, root = self.store.filesystem, self.store.root
        try:
            if not self.store.replaces_at_once:  # an object store has no folders
                filesystem.create_dir(root, recursive=True)
            info = filesystem.get_file_info(f"{root}/{_RUN}")
            if info.type == filesystems.FileType.NotFound:
                self.store.write(_RUN, json.dumps(question, indent=1).encode())
                return
            with filesystem.open_input_stream(f"{root}/{_RUN}") as stream:
                before = json.loads(stream.read())
        except (OSError, ValueError) as error:
            raise LocationError(f"{self.store.name(root)}: {error}") from error
        for name in question.keys() | before.keys():
            if question.get(name) != before.get(name):
                raise AnotherRunError(
                    f"{self.store.name(root)} holds answers with {name} {before.get(name)}, not {question.get(name)}; "
                    "name another folder"
                )

    def done(self) -> Done:
        """What has its row already."""
        files: set[str] = set()
        shards: set[str] = set()
        for batch in self._batches(["path", "shard"]):
            for path, shard in zip(*(column.to_pylist() for column in batch.columns), strict=True):
                if shard is None:
                    files.add(path)
                else:
                    shards.add(shard)
        return Done(frozenset(files), frozenset(shards))

    def rows(self) -> Iterator[dict[str, Any]]:
        """What a summary tells about every row."""
        for batch in self._batches(list(_SUMMARY)):
            yield from batch.to_pylist()

    def _batches(self, names: Iterable[str]) -> Iterator[Any]:
        """The columns ``names`` of all result files, some rows at a time."""
        selector = filesystems.FileSelector(self.store.root, allow_not_found=True)
        found = (info.path for info in self.store.filesystem.get_file_info(selector))
        paths = sorted(path for path in found if path.endswith(".parquet") and "/_" not in path)
        if paths:
            whole = dataset.dataset(paths, columns.schema(), "parquet", self.store.filesystem)
            yield from whole.to_batches(columns=list(names), batch_readahead=2, fragment_readahead=2)
