"""Judgement of refined candidates on the exact distance, with samples that took no part in refining them."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from model.geometry.operations import Operations
from model.geometry.refinement import squared_distances
from model.geometry.surface import SurfaceIndex
from model.types import BoolArray, FloatArray

EXACT_ERROR = 1e-6
"""An SDE below this is symmetry up to modelling precision: an RMS deviation of 0.1 % of the bounding sphere's diameter.

docs/full-mode.md shows the distribution of errors behind it."""

CERTAIN_ERROR = 1e-9
"""Below this a symmetry needs no comparison with its neighbours, however small the part that tells them apart."""

SAMPLES, MORE_SAMPLES = 1000, 5000
_MANY = 3
"""Beyond so many elements each is judged on fewer samples, a large group being its own proof, ..."""

_FEWEST = 200
"""... but on this many at least."""

_CLOSE_CALL = 1.3
_CONFIDENCE = 2.0
"""The mean plus so many standard errors must stay within the threshold: other samples should not overturn it."""

_NEAR = np.deg2rad((-12.0, 12.0))
_TIGHT = np.deg2rad((-18.0, -12.0, -7.0, 7.0, 12.0, 18.0))
_FAR = np.deg2rad((-70.0, -50.0, -30.0, 30.0, 50.0, 70.0, 90.0))
_BETTER_THAN_NEAR, _BETTER_BESIDE_OTHERS, _BETTER_THAN_FAR = 2.0, 4.0, 10.0
"""A symmetry that is not exact must stand out: so many times better than the same element tilted by each of the near
angles, and than the worst of the far ones, whichever way it is tilted. Else the shape is only round, thin or a lump,
and others would do as well. Beside better symmetries the bar is higher: the teeth of a gear that turns one way mirror
onto each other fairly well in as many planes as there are teeth."""

_KEPT = 0.75
"""Where a part is missing, the comparison is made without the worst quarter of the samples."""

_FEW = 64


@dataclass(frozen=True, slots=True)
class Judge:
    """Measures operations on ``samples`` ``(n, 3)`` of a ``surface``, unit frame, against ``max_error``.

    ``more`` draws many further samples, for the close calls.
    """

    surface: SurfaceIndex
    samples: FloatArray
    max_error: float
    more: Callable[[], FloatArray]

    def errors(self, operations: Operations) -> tuple[FloatArray, BoolArray]:
        """The SDE of every operation, and whether it is safely within the threshold: ``(k,)`` each."""
        every = max(1, min(len(self.samples) // _FEWEST, -(-len(operations) // _MANY)))
        errors, safe = self._measured(self.samples[::every], operations)
        close = np.flatnonzero(~safe & (errors < _CLOSE_CALL * self.max_error))
        if len(close):
            errors[close], safe[close] = self._measured(self.more(), operations[close])
        return errors, safe

    def _measured(self, samples: FloatArray, operations: Operations) -> tuple[FloatArray, BoolArray]:
        squared = squared_distances(self.surface, samples, operations)
        errors = squared.mean(1)
        spread = squared.std(1) / np.sqrt(len(samples))
        return errors, errors + _CONFIDENCE * spread <= self.max_error

    def stands_out(self, operation: Operations, *, beside_others: bool = False, whole: bool = False) -> bool:
        """Whether one operation (a batch of one, not a centre) is distinctly better than its neighbours.

        Args:
            operation: refined, but not exact.
            beside_others: the shape has a group of symmetries that this is none of.
            whole: the shape has exact symmetries, so that no missing part can be what disturbs this one.
        """
        samples = self.samples[:: max(1, len(self.samples) // _FEW)]
        own = np.sort(squared_distances(self.surface, samples, operation))
        factor = _BETTER_BESIDE_OTHERS if beside_others else _BETTER_THAN_NEAR
        first, second = tangents(operation.directions[0])
        around = self._tilted(operation, samples, _angled(first, second, np.pi / 4.0 * np.arange(4.0)), _NEAR)
        soft = _softest(around.mean(-1).sum(1))
        lines = _angled(first, second, np.array([soft, soft + np.pi / 2.0]))
        if beside_others:
            around = np.concatenate([around.reshape(8, -1), self._tilted(operation, samples, lines[:1], _TIGHT)[0]])
        near = around.reshape(-1, around.shape[-1])
        far: FloatArray | None = None
        for kept in (1.0,) if whole else (1.0, _KEPT):
            count = int(kept * len(samples))
            error = float(own[:, :count].mean())
            if near[:, :count].mean(1).min() <= max(factor * error, CERTAIN_ERROR):
                continue
            far = self._tilted(operation, samples, lines, _FAR) if far is None else far
            if far[..., :count].mean(-1).max(1).min() > _BETTER_THAN_FAR * error:
                return True
        return False

    def _tilted(self, operation: Operations, samples: FloatArray, lines: FloatArray, angles: FloatArray) -> FloatArray:
        """Sorted squared distances ``(lines, angles, n)`` after tilting the element about lines through its point."""
        turns = (angles[None, :, None] * lines[:, None]).reshape(-1, 3)
        part = operation[[0] * len(turns)]
        tilted = Operations(part.moved(turns, turns).directions, part.points, part.angles, part.improper)
        return np.sort(squared_distances(self.surface, samples, tilted)).reshape(len(lines), len(angles), -1)


def _angled(first: FloatArray, second: FloatArray, angles: FloatArray) -> FloatArray:
    """Unit vectors at angles from the first of two perpendicular ones: ``(k, 3)``."""
    return np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second


def _softest(errors: FloatArray) -> float:
    """The angle about which tilting costs least, from the cost at 0, 45, 90 and 135 degrees, taken for quadratic."""
    return float(np.arctan2(errors[1] - errors[3], errors[0] - errors[2]) / 2.0 + np.pi / 2.0)


def tangents(direction: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Two unit vectors perpendicular to a unit ``direction`` ``(3,)`` and to each other."""
    helper = np.zeros(3)
    helper[int(np.argmin(np.abs(direction)))] = 1.0
    first = np.cross(direction, helper)
    first /= np.linalg.norm(first)
    return first, np.cross(direction, first)
