"""What is missing, cut into pieces that an actor works on and writes at a time."""

from collections.abc import Iterable
from dataclasses import dataclass

from app.bulk.locations import Input
from app.bulk.results import Done

MOST_FILES = 500
_PIECES_A_WORKER = 8
_BESIDE_BYTES = 20_000
"""What a mesh costs beside its bytes, in bytes: finding its symmetries depends little on its size."""


@dataclass(frozen=True, slots=True)
class Piece:
    """Files of their own, or one shard."""

    paths: list[str]
    sizes: list[int]
    shard: bool

    @property
    def cost(self) -> int:
        """Its share of the work, of no unit."""
        return sum(self.sizes) + _BESIDE_BYTES * len(self.paths)


def missing(inputs: Iterable[Input], done: Done) -> list[Input]:
    """The inputs that have no row yet."""
    return [item for item in inputs if item.path not in (done.shards if item.is_shard else done.files)]


def pieces(inputs: Iterable[Input], workers: int, most: int = MOST_FILES) -> list[Piece]:
    """The inputs in pieces: small enough that all workers have some to the end, large enough to be few files.

    ``most`` files a piece; a shard is a piece of its own. Shards come first: they take longest.
    """
    inputs = list(inputs)
    shards = [Piece([item.path], [item.size], True) for item in inputs if item.is_shard]
    files = [item for item in inputs if not item.is_shard]
    size = max(1, min(most, len(files) // (_PIECES_A_WORKER * workers)))
    cut = (files[at : at + size] for at in range(0, len(files), size))
    shards.sort(key=lambda piece: -piece.sizes[0])
    return shards + [Piece([item.path for item in part], [item.size for item in part], False) for part in cut]
