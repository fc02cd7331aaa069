"""A shape made ready for full mode: everything its search measures with."""

from dataclasses import dataclass

import numpy as np

from model.geometry.operations import Operations
from model.geometry.scan import DistanceGrid
from model.geometry.surface import SurfaceIndex
from model.search.judgement import Judge
from model.types import FloatArray

PROMISING_PLANE, PROMISING_AXIS = 1.5, 0.7
"""Scores of the scan, in squared voxels, above which nothing is worth refining. Clear planes score below 0.5; a missing
part adds nine times its share of the surface."""


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """A surface in the unit frame, ready to be searched.

    ``samples`` ``(n, 3)`` of the surface serve refinement, together with ``anchors`` ``(m, 3)``, extreme vertices that
    hold fast what hardly a sample hits, corners and rims; the `judge` has samples of its own. ``grid`` holds the voxels
    in the frame that ``turn`` ``(3, 3)`` takes the unit frame to; the rows of ``principal`` ``(3, 3)`` are the inertia
    frame's axes.
    """

    surface: SurfaceIndex
    samples: FloatArray
    anchors: FloatArray
    judge: Judge
    grid: DistanceGrid
    turn: FloatArray
    principal: FloatArray

    @property
    def centre(self) -> FloatArray:
        """The mean of the occupied voxels, unit frame."""
        return self.grid.centre @ self.turn

    @property
    def max_error(self) -> float:
        """The threshold on the SDE."""
        return self.judge.max_error

    def points(self, every: int) -> FloatArray:
        """What to refine on: every so many-th sample, and all anchors."""
        return np.concatenate([self.samples[::every], self.anchors])

    def scores(self, operations: Operations) -> FloatArray:
        """The scan's score of arbitrary operations: ``(k,)``."""
        images = operations.apply(self.grid.points @ self.turn)
        return self.grid.score(images @ self.turn.T)
