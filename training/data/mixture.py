"""Several prepared sets as one, each with its share of the draws."""

import hashlib
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from training.data.prepared import FORMAT_VERSION, PreparedSet


class Mixture(PreparedSet):
    """Prepared sets one after the other, the first of them the main one.

    Shapes are numbered through; ``part_of`` ``(n,)`` says whose each one is and ``shares`` how much of what is drawn
    comes from each set. Validation takes shapes of the main set alone, so that runs with and without additions can be
    compared.
    """

    def __init__(self, main: PreparedSet, others: Sequence[tuple[PreparedSet, float]]) -> None:
        """Mix ``others``, with their shares, into ``main``, which keeps the rest.

        Raises:
            ValueError: a share is not positive, or nothing is left for the main set.
        """
        rest = 1.0 - sum(share for _, share in others)
        if rest <= 0.0 or any(share <= 0.0 for _, share in others):
            raise ValueError("shares of sets to mix in must be positive and leave something for the main set")
        self.parts = [main, *(part for part, _ in others)]
        self.shares = (rest, *(share for _, share in others))
        self.root = main.root
        self.shapes = [shape for part in self.parts for shape in part.shapes]
        self.part_of: NDArray[np.int64] = np.repeat(np.arange(len(self.parts)), [len(part) for part in self.parts])
        resolutions = {part.manifest["resolution"] for part in self.parts}
        lines = [f"{part.sha256} {share:.6f}\n" for part, share in zip(self.parts, self.shares, strict=True)]
        self.manifest = {
            "version": FORMAT_VERSION,
            "resolution": resolutions.pop() if len(resolutions) == 1 else None,
            "shapes": len(self.shapes),
            "skipped": sum(part.manifest["skipped"] for part in self.parts),
            "sha256": hashlib.sha256("".join(lines).encode()).hexdigest(),
            "shards": [entry for part in self.parts for entry in part.manifest["shards"]],
        }

    @cached_property
    def labels(self) -> dict[str, Any] | None:
        """The records of every part's labels; None unless all have some."""
        records = [part.labels for part in self.parts]
        return None if any(record is None for record in records) else {"sets": records}

    @cached_property
    def views(self) -> dict[str, Any] | None:
        """The records of every part's pieces and views; None unless all have some."""
        records = [part.views for part in self.parts]
        return None if any(record is None for record in records) else {"sets": records}

    @cached_property
    def shards(self) -> list[Path]:
        """The shard folders of all parts in order."""
        return [shard for part in self.parts for shard in part.shards]

    def split(self, validation_share: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Indices for training, of all parts, and for validation, of the main one."""
        train, held_out = super().split(validation_share)
        return train, held_out[held_out < len(self.parts[0])]

    def record(self) -> dict[str, Any]:
        """Hash and size of the whole, and of every part with its share."""
        parts = [
            {**part.record(), "share": round(share, 6)} for part, share in zip(self.parts, self.shares, strict=True)
        ]
        return {**super().record(), "sets": parts}
