"""Keeps an upload: in memory up to a size, beyond it in a file without a name, which vanishes when it is closed."""

import tempfile
from dataclasses import dataclass
from typing import BinaryIO

_PIECE = 256 * 1024  # so little at a time that writing it does not hold up the event loop


@dataclass(frozen=True, slots=True)
class Upload:
    """An uploaded file: its sanitised base name, its size, and its bytes or the file they are in."""

    filename: str
    size: int
    data: bytes
    file: BinaryIO | None = None

    @property
    def source(self) -> bytes | int:
        """The bytes, or a descriptor of the file."""
        return self.data if self.file is None else self.file.fileno()

    def __enter__(self) -> "Upload":
        return self

    def __exit__(self, *_: object) -> None:
        if self.file is not None:
            self.file.close()


class Spool:
    """Takes an upload's bytes as they arrive; at most ``memory_limit`` of them, and a chunk, are held in memory."""

    def __init__(self, memory_limit: int, directory: str | None) -> None:
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
        self._buffer += data
        if len(self._buffer) > (self._memory_limit if self._file is None else _PIECE):
            self._flush()

    def finish(self, filename: str) -> Upload:
        """The upload; it is now the caller's to close."""
        if self._file is None:
            return Upload(filename, len(self._buffer), bytes(self._buffer))
        self._flush()
        return Upload(filename, self._written, b"", self._file)

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
