"""What the network says of one shape, asked only when it is needed: little where all is there, more where it is not."""

import time
from collections.abc import Sequence
from functools import cached_property

import numpy as np

from model.network.checkpoint import Checkpoint
from model.network.proposals import Proposals, predict_each, rotated_voxels
from model.network.views import other_views
from model.types import BoolArray, FloatArray, IntArray

_FRAMES_EACH = 2
"""Sign choices of each view, where part of the surface is not there. Where it is closed, more than the first one of the
main frame found no more planes (decision 5)."""


class NetworkOutput:
    """The network's answers for one shape, computed when they are first asked for.

    ``spent_ms``: milliseconds of wall clock that this took so far.

    Args:
        checkpoint: the network.
        vertices: ``(v, 3)``, unit frame.
        faces: ``(f, 3)``.
        voxels: ``(R, R, R)`` of the main view.
        rotation: ``(3, 3)`` from the unit frame to that of ``voxels``.
    """

    def __init__(
        self, checkpoint: Checkpoint, vertices: FloatArray, faces: IntArray, voxels: BoolArray, rotation: FloatArray
    ) -> None:
        self._checkpoint, self._vertices, self._faces = checkpoint, vertices, faces
        self._voxels, self._rotation = voxels, rotation
        self.spent_ms = 0.0

    @cached_property
    def first(self) -> Proposals:
        """What each head says of the main view in the first sign frame, unit frame."""
        return self._asked(self._rotation, slice(1))

    @cached_property
    def every(self) -> Proposals:
        """What each head says of each view in several sign frames, unit frame: the voters of `model.search.prediction`.

        Of a shape part of which is not there the answers differ, by a degree or altogether.
        """
        frames = [self.first, self._asked(self._rotation, slice(1, _FRAMES_EACH))]
        main = Proposals(
            _interleaved([frame.planes for frame in frames]),
            _interleaved([frame.directions for frame in frames]),
            _interleaved([frame.angles for frame in frames]),
        )
        # One view after the other: all in one batch hold three times the memory, and take as long.
        views = [main, *(self._asked(turn, slice(_FRAMES_EACH)) for turn in other_views(self._rotation))]
        return Proposals(
            np.concatenate([view.planes for view in views]),
            np.concatenate([view.directions for view in views]),
            np.concatenate([view.angles for view in views]),
        )

    def _asked(self, rotation: FloatArray, frames: slice) -> Proposals:
        mark = time.perf_counter()
        voxels = self._voxels
        if rotation is not self._rotation:
            voxels = rotated_voxels(self._checkpoint, self._vertices, self._faces, rotation)
        answer = predict_each(self._checkpoint, voxels, rotation, frames)
        self.spent_ms += (time.perf_counter() - mark) * 1e3
        return answer


def _interleaved(parts: Sequence[FloatArray]) -> FloatArray:
    """Rows of several arrays ``(n, ...)`` in turn: of each head all frames, as `predict_each` gives them."""
    return np.stack(parts, axis=1).reshape(-1, *parts[0].shape[1:])
