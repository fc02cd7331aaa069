"""Keeps an upload: in memory up to a size, beyond it in a file without a name, which vanishes when it is closed.

Nothing can change such a file once the upload is complete, not even whoever reads it: on disk nobody has it open for
writing or may open it again; in memory it is sealed.
"""

import fcntl
import hashlib
import os
import sys
import tempfile
from dataclasses import dataclass
from typing import Final

IN_MEMORY: Final = "memory"
"""Said in place of a folder: large uploads are kept in memory too, in sealed files."""

_PIECE = 256 * 1024  # so little at a time that writing it does not hold up the event loop


@dataclass(frozen=True, slots=True)
class Upload:
    """What was uploaded: the mesh's sanitised base name, and the bytes of all files or a descriptor of what holds them.

    ``parts`` are name and size of every file in the order of its bytes; empty where the mesh came alone. ``digest`` is
    that of all bytes, empty if it was not asked for.
    """

    filename: str
    size: int
    data: bytes
    descriptor: int | None = None
    parts: tuple[tuple[str, int], ...] = ()
    digest: str = ""

    @property
    def source(self) -> bytes | int:
        """The bytes, or a descriptor by which they can only be read."""
        return self.data if self.descriptor is None else self.descriptor

    def __enter__(self) -> "Upload":
        return self

    def __exit__(self, *_: object) -> None:
        if self.descriptor is not None:
            os.close(self.descriptor)


class Spool:
    """Takes an upload's bytes as they arrive; at most ``memory_limit`` of them, and a chunk, are held in a buffer.

    With ``hashing`` their digest is taken on the way.
    """

    def __init__(self, memory_limit: int, directory: str | None, *, hashing: bool = False) -> None:
        self._hash = hashlib.sha256() if hashing else None
        self._memory_limit = memory_limit
        self._directory = directory
        self._buffer = bytearray()
        self._writer: int | None = None
        self._reader: int | None = None
        self._written = 0

    def write(self, data: memoryview) -> None:
        """Add bytes.

        Raises:
            OSError: the disk is full.
        """
        if self._hash is not None:
            self._hash.update(data)
        self._buffer += data
        if len(self._buffer) > (self._memory_limit if self._writer is None else _PIECE):
            self._flush()

    def finish(self, filename: str, parts: tuple[tuple[str, int], ...] = ()) -> Upload:
        """The upload; it is now the caller's to close.

        Raises:
            OSError: the disk is full.
        """
        digest = "" if self._hash is None else self._hash.hexdigest()
        if self._writer is None:
            return Upload(filename, len(self._buffer), bytes(self._buffer), parts=parts, digest=digest)
        self._flush()
        descriptor = self._seal()
        return Upload(filename, self._written, b"", descriptor, parts, digest)

    def close(self) -> None:
        """Forget everything."""
        self._buffer.clear()
        for descriptor in {self._writer, self._reader}:
            if descriptor is not None:
                os.close(descriptor)
        self._writer = self._reader = None

    def _flush(self) -> None:
        if self._writer is None:
            self._open()
        assert self._writer is not None
        with memoryview(self._buffer) as view:
            at = 0
            while at < len(view):
                at += os.write(self._writer, view[at : at + _PIECE])
        self._written += len(self._buffer)
        self._buffer.clear()

    def _open(self) -> None:
        if sys.platform == "linux" and self._directory == IN_MEMORY:
            self._writer = self._reader = os.memfd_create("prsnet", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
            return
        self._writer, path = tempfile.mkstemp(dir=self._directory, prefix="prsnet-")
        try:
            self._reader = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        finally:
            os.unlink(path)
        os.fchmod(self._writer, 0)  # no other way to it is ever opened

    def _seal(self) -> int:
        """The descriptor to read from, when all is written."""
        assert self._writer is not None
        assert self._reader is not None
        if sys.platform == "linux" and self._writer == self._reader:
            seals = fcntl.F_SEAL_SEAL | fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_WRITE
            fcntl.fcntl(self._writer, fcntl.F_ADD_SEALS, seals)
        else:
            os.close(self._writer)
        descriptor, self._writer, self._reader = self._reader, None, None
        return descriptor
