"""A shape made ready for full mode: everything its search measures with."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from model.geometry.operations import Operations
from model.geometry.sampling import SurfaceSampler
from model.geometry.scan import DistanceGrid, directions, lowest, minima
from model.geometry.surface import WORK, SurfaceIndex
from model.search.deviation import DeviationMeter, SurfaceSamples
from model.search.settings import DEFAULT, SearchSettings
from model.types import FloatArray

_LEFT_TO_JUDGE = 0.4 * WORK
"""What is left for judging what was found when a search is cut short."""

_MANY_SEED = 3

_ODD_LINES, _ODD_ANGLES = 2, (2.0 * np.pi / 3.0, 4.0 * np.pi / 5.0, 6.0 * np.pi / 7.0)


@dataclass(frozen=True, eq=False)
class SearchContext:
    """A surface in the unit frame, ready to be searched.

    ``sampler`` draws from the surface; ``samples`` of it serve refinement, together with ``anchors`` ``(m, 3)``,
    extreme vertices that hold fast what hardly a sample hits, corners and rims; hypotheses are compared on ``judging``,
    other samples. ``grid`` holds the voxels in the frame that ``rotation`` ``(3, 3)`` takes the unit frame to; the rows
    of ``principal`` ``(3, 3)`` are the inertia frame's axes. ``max_error`` is the threshold on the SDE.
    """

    meter: DeviationMeter
    sampler: SurfaceSampler
    samples: SurfaceSamples
    anchors: FloatArray
    judging: SurfaceSamples
    grid: DistanceGrid
    rotation: FloatArray
    principal: FloatArray
    max_error: float
    settings: SearchSettings = field(default=DEFAULT)

    @property
    def surface(self) -> SurfaceIndex:
        """What distances are measured from."""
        return self.meter.surface

    @property
    def limit(self) -> float:
        """The largest RMS deviation of a symmetry: the root of ``max_error``."""
        return float(np.sqrt(self.max_error))

    @property
    def is_spent(self) -> bool:
        """Whether the search has to end, so that what it has found can still be judged."""
        return self.surface.work_left < _LEFT_TO_JUDGE

    @property
    def centre(self) -> FloatArray:
        """The mean of the occupied voxels, unit frame."""
        return self.grid.centre @ self.rotation

    @cached_property
    def many(self) -> SurfaceSamples:
        """Many more samples, drawn when something hangs on them: on few, noise hides a small difference."""
        return SurfaceSamples.drawn(self.sampler, self.settings.many_samples, seed=_MANY_SEED)

    def points(self, stride: int) -> FloatArray:
        """What to refine on: every so many-th sample, and all anchors."""
        return np.concatenate([self.samples.points[::stride], self.anchors])

    def scores(self, operations: Operations, most: float = np.inf) -> FloatArray:
        """The voxel scan's score of arbitrary operations, in squared voxels: ``(k,)``; see `DistanceGrid.score`."""
        return self.grid.score(self._in_grid(operations), most)

    def odd_lines(self) -> FloatArray:
        """Directions through the centre that turns of odd orders about map the voxels onto themselves best: ``(k, 3)``.

        The angles are those next to half a turn; larger orders than these have one that is nearly the same.
        """
        lines, promising = directions(), self.settings.promising_axis
        found = [np.zeros((0, 3))]
        for angle in _ODD_ANGLES:
            scores = self.grid.score(Operations.rotations(lines, self.grid.centre, angle), promising)
            found.append(minima(scores, _ODD_LINES, promising))
        return np.concatenate(found) @ self.rotation

    def shifted_planes(self) -> FloatArray:
        """Planes off the centre that map the voxels onto themselves best, ``(k, 4)``: of each shift some.

        What is missing moves the centre away from planes that it lies on one side of. They may be any way off; midway
        between what reaches farthest on either side, unless just that is missing.
        """
        lines, settings = directions(), self.settings
        along = (self.anchors @ self.rotation.T) @ lines.T
        shifts = np.array([[-2.0], [-1.0], [1.0], [2.0]]) * settings.shift - self.grid.centre @ lines.T
        offsets = np.concatenate([shifts, -(along.min(0) + along.max(0))[None] / 2.0])
        found = [np.zeros((0, 4))]
        scanned = self.grid.scan_planes(offsets, settings.promising_holed)
        for each, scores in zip(offsets, scanned, strict=True):
            best = lowest(scores, settings.most_planes, settings.promising_holed)
            found.append(np.column_stack([lines[best] @ self.rotation, each[best]]))
        return np.concatenate(found)

    def interpolated_errors(self, operations: Operations) -> FloatArray:
        """Finer scores, see `DistanceGrid.interpolated_error`: ``(k,)``."""
        return self.grid.interpolated_error(self._in_grid(operations))

    def settled_on_voxels(self, operations: Operations) -> Operations:
        """Operations moved to where they map the voxels onto themselves best nearby, see `DistanceGrid.settle`."""
        settled = self.grid.settle(self._in_grid(operations))
        return Operations(
            settled.directions @ self.rotation, settled.points @ self.rotation, settled.angles, settled.improper
        )

    def _in_grid(self, operations: Operations) -> Operations:
        directions, points = operations.directions @ self.rotation.T, operations.points @ self.rotation.T
        return Operations(directions, points, operations.angles, operations.improper)
