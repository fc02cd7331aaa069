"""Reading tar files of meshes (the layout of WebDataset) from front to back, a member at a time."""

import lzma
import tarfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO, Any

from app.bulk.locations import MESHES

SHARD_ERRORS = (tarfile.TarError, OSError, EOFError, zlib.error, lzma.LZMAError)
"""What reading a damaged shard may raise."""


@dataclass(frozen=True, slots=True)
class Member:
    """A mesh in a shard. ``data`` is None where there is more of it than may be read."""

    name: str
    size: int
    data: bytes | None


def members(stream: IO[bytes], most_bytes: int) -> Iterator[Member]:
    """The meshes of a shard, compressed or not, in its order; a name that occurs again gets a number.

    Raises:
        SHARD_ERRORS: the shard is damaged from here on.
    """
    seen: dict[str, int] = {}
    with tarfile.open(fileobj=stream, mode="r|*") as tar:
        kept: Any = tar  # a list that is no part of its interface
        for member in tar:
            kept.members.clear()  # it would keep all of them
            if not member.isfile() or not member.name.lower().endswith(MESHES):
                continue
            count = seen[member.name] = seen.get(member.name, 0) + 1
            name = member.name if count == 1 else f"{member.name}#{count}"
            content = tar.extractfile(member) if member.size <= most_bytes else None
            yield Member(name, member.size, None if content is None else content.read())
