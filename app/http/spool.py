"""Keeps an upload: in memory up to a size, beyond it in a file without a name, which vanishes when it is closed."""

import hashlib
import os
import tempfile
from dataclasses import dataclass
from typing import BinaryIO

_PIECE = 256 * 1024  # so little at a time that writing it does not hold up the event loop


@dataclass(frozen=True, slots=True)
class Upload:
    """What was uploaded: the mesh's sanitised base name, and the bytes of all files or the file they are in.

    ``parts`` are name and size of every file in the order of its bytes; empty where the mesh came alone. ``digest`` is
    that of all bytes, empty if it was not asked for.
    """

    filename: str
    size: int
    data: bytes
    file: BinaryIO | None = None
    parts: tuple[tuple[str, int], ...] = ()
    descriptor: int | None = None
    digest: str = ""

    @property
    def source(self) -> bytes | int:
        """The bytes, or a descriptor of the file that can only be read."""
        if self.file is None:
            return self.data
        return self.file.fileno() if self.descriptor is None else self.descriptor

    def __enter__(self) -> "Upload":
        return self

    def __exit__(self, *_: object) -> None:
        if self.descriptor is not None:
            os.close(self.descriptor)
        if self.file is not None:
            self.file.close()


class Spool:
    """Takes an upload's bytes as they arrive; at most ``memory_limit`` of them, and a chunk, are held in memory.

    With ``hashing`` their digest is taken on the way.
    """

    def __init__(self, memory_limit: int, directory: str | None, *, hashing: bool = False) -> None:
        self._hash = hashlib.sha256() if hashing else None
        self._memory_limit = memory_limit
        self._directory = directory
        self._buffer = bytearray()
        self._file: BinaryIO | None = None
        self._written = 0

    def write(self, data: memoryview) -> None:
        """Add bytes.

        Raises:
            OSError: the disk is full.
        """
        if self._hash is not None:
            self._hash.update(data)
        self._buffer += data
        if len(self._buffer) > (self._memory_limit if self._file is None else _PIECE):
            self._flush()

    def finish(self, filename: str, parts: tuple[tuple[str, int], ...] = ()) -> Upload:
        """The upload; it is now the caller's to close."""
        digest = "" if self._hash is None else self._hash.hexdigest()
        if self._file is None:
            return Upload(filename, len(self._buffer), bytes(self._buffer), parts=parts, digest=digest)
        self._flush()
        # Opened once more, so that the worker that gets it cannot write to it, whatever its limits.
        path = f"/proc/self/fd/{self._file.fileno()}"
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC) if os.path.exists(path) else None
        return Upload(filename, self._written, b"", self._file, parts, descriptor, digest)

    def close(self) -> None:
        """Forget everything."""
        self._buffer.clear()
        if self._file is not None:
            self._file.close()

    def _flush(self) -> None:
        if self._file is None:
            self._file = tempfile.TemporaryFile(buffering=0, dir=self._directory, prefix="prsnet-")  # noqa: SIM115 - closed by `Upload`
        with memoryview(self._buffer) as view:
            at = 0
            while at < len(view):
                at += self._file.write(view[at : at + _PIECE])
        self._written += len(self._buffer)
        self._buffer.clear()
