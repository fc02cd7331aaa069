"""A point group placed in a shape: one hypothesis about all of its symmetries at once."""

from dataclasses import dataclass
from functools import lru_cache
from math import gcd

import numpy as np

from model.geometry.operations import Operations
from model.geometry.refinement import refine_frame, squared_distances
from model.search.context import SearchContext
from model.search.deviation import SurfaceSamples
from model.search.point_groups import ARBITRARY_ANGLES, CONTINUOUS, PointGroup, contains, point_group
from model.search.settings import SearchSettings
from model.types import BoolArray, FloatArray

_MOST_MEASURED = 10
_MOST_FITTED = 6
_SAME_MATRIX = 1e-9
_MEASUREMENTS = 1000
"""Distances a hypothesis costs: of more operations each is measured on fewer samples."""

_CLOSE_SCALE, _AS_GOOD = 0.02, 1.5
_SETTLING_STRIDE, _NOISE_STRIDE = 3, 2
_SETTLED = 1e-6
"""Part of what the coordinates promise: a frame that moves less is settled."""

_SETTLING = 1e-3
"""Where half of the points deviate by more, no place nearby takes most of them onto the surface exactly."""


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """A point group with its place in the unit frame, and how well the shape bears it out.

    ``frame`` ``(3, 3)``: a proper rotation whose rows are the axes of the group's own frame; ``centre`` ``(3,)``: its
    fixed point. ``rms``: largest RMS deviation of the operations measured, where a counterpart is there; ``as_is``: as
    if nothing were missing; ``missing``, ``coverage``, ``contradicting``: shares of the surface, the worst over the
    operations (`model.search.deviation`).
    """

    group: PointGroup
    frame: FloatArray
    centre: FloatArray
    rms: float = 0.0
    as_is: float = 0.0
    missing: float = 0.0
    coverage: float = 1.0
    contradicting: float = 0.0

    @property
    def name(self) -> str:
        """The Schoenflies symbol."""
        return self.group.name

    @property
    def axis(self) -> FloatArray:
        """The direction of the principal axis ``(3,)``: the last row of the frame."""
        return self.frame[2]

    @property
    def turning_axis(self) -> FloatArray | None:
        """Its direction if all else may be turned about it by less than a right angle, its order being 3 or more."""
        turns = self.group.principal_order not in (1, 2) and self.name[0] not in "TOIK"
        return self.axis if turns else None

    @property
    def planes(self) -> FloatArray:
        """All planes ``(p, 4)``, rows ``(n, d)``, of a family through a continuous axis two."""
        normals = self.group.normals @ self.frame
        return np.column_stack([normals, -normals @ self.centre])

    @property
    def directions(self) -> FloatArray:
        """The directions of all axes ``(a, 3)``; their orders are those of the group."""
        return self.group.directions @ self.frame

    @property
    def matrices(self) -> FloatArray:
        """The linear parts of all members ``(g, 3, 3)``; none of a continuous group."""
        return self.frame.T @ self.group.matrices @ self.frame

    @property
    def generators(self) -> Operations:
        """Operations that generate the group."""
        return self._placed(self.group.generators)

    @property
    def telling(self) -> Operations:
        """The generators, with rotations by as near to half a turn as generates all of them: small ones move little."""
        operations = self.generators
        if self.name in CONTINUOUS:
            return operations
        angles = operations.angles.copy()
        for k in np.flatnonzero(~operations.improper & (angles > 0.0)).tolist():
            order = round(2.0 * np.pi / float(angles[k]))
            angles[k] *= max(multiple for multiple in range(1, order // 2 + 1) if gcd(multiple, order) == 1)
        return Operations(operations.directions, operations.points, angles, operations.improper)

    @property
    def elements(self) -> Operations:
        """Reflections in all planes, then the smallest rotation about each axis."""
        return self._placed(_elements(self.group))

    def contains(self, operations: Operations, angle: float, distance: float) -> BoolArray:
        """Which operations are members up to an angle, radians, and a distance of their elements: ``(k,)``."""
        local = self.frame @ operations.matrices @ self.frame.T
        moved = operations.apply(self.centre[None])[:, 0] - self.centre
        near = np.square(moved).sum(1) < (2.0 * distance) ** 2
        return np.asarray(near & contains(self.group, local, angle))

    @property
    def measured_operations(self) -> Operations:
        """The generators, and some elements of larger groups."""
        return self._placed(_chosen(self.group, _MOST_MEASURED))

    def measured(
        self,
        context: SearchContext,
        *,
        thoroughly: bool = False,
        samples: SurfaceSamples | None = None,
        stride: int = 1,
    ) -> "Hypothesis":
        """The same with deviations measured where it is: of the generators, and of some elements of large groups.

        Args:
            context: the shape.
            thoroughly: on all samples, however many operations there are.
            samples: others than the context's.
            stride: of the samples every so many-th at most.
        """
        operations = self.measured_operations
        if not len(operations):
            return self
        samples = context.judging if samples is None else samples
        if not thoroughly:
            stride = max(stride, -(-len(operations) * len(samples) // _MEASUREMENTS))
        deviations = context.meter.measure(operations, samples.every(stride))
        distance = context.settings.fit_distance
        return Hypothesis(
            self.group,
            self.frame,
            self.centre,
            float(deviations.rms.max()),
            float(deviations.as_is.max()),
            float(deviations.missing_share.max()),
            float(deviations.coverage(distance).min()),
            float(deviations.contradicting(distance).max()),
        )

    def noise(self, context: SearchContext) -> float:
        """The part of its RMS deviation that is noise, see `DeviationMeter.noise`: the least over its generators."""
        return min(
            self.rms,
            float(context.meter.noise(self.generators, context.judging.every(_NOISE_STRIDE)).min(initial=np.inf)),
        )

    def is_believed(self, settings: SearchSettings) -> bool:
        """Whether enough of the surface bears it out, and not too much contradicts it."""
        return self.coverage >= settings.least_coverage and self.contradicting <= settings.most_contradicting

    @property
    def _fit_operations(self) -> Operations:
        """The generators, and some elements if these are few: what the frame is fitted to."""
        if self.name in CONTINUOUS:
            return self.generators
        return self._placed(_chosen(self.group, _MOST_FITTED))

    def fitted(self, context: SearchContext, *, stride: int = 3, steps: int = 8) -> "Hypothesis":
        """The same after its frame was fitted to the surface, and measured there.

        Args:
            context: the shape.
            stride: every so many-th sample is fitted to.
            steps: of the fit.
        """
        operations = self._fit_operations
        if not len(operations):
            return self
        holed = self.missing > 0.01
        points = context.points(stride)
        frame, centre = refine_frame(
            context.surface,
            points,
            operations,
            self.frame,
            self.centre,
            steps,
            scale=_CLOSE_SCALE,
            quantile=0.5 if holed else 0.75,
            trust_rms=not holed,
            step_tolerance=1e-8,
        )
        return Hypothesis(self.group, frame, centre, missing=self.missing).measured(context)

    def settled(self, context: SearchContext, points: FloatArray, allowed: float) -> "Hypothesis":
        """The same where most of some points ``(n, 3)`` fit exactly, if there is such a place nearby.

        Features without a counterpart pull a little even where they hardly count. Where most images lie on the surface
        to what the coordinates promise, ``allowed``, the rest has no say at all.
        """
        operations = self.generators
        if not len(operations):
            return self
        squared = self._squared_distances(context, points)
        share = _share_within(squared, allowed)
        # Where all fits already or hardly anything does, there is nothing to settle.
        if share == 1.0 or np.median(squared) > _SETTLING**2:
            return self
        frame, centre = refine_frame(
            context.surface,
            points[::_SETTLING_STRIDE],
            operations,
            self.frame,
            self.centre,
            24,
            scale=_CLOSE_SCALE / 4.0,
            final_scale=0.1 * allowed,
            quantile=None,
            trust_rms=False,
            step_tolerance=_SETTLED * allowed,
        )
        settled = Hypothesis(self.group, frame, centre, missing=self.missing).measured(context)
        better = _share_within(settled._squared_distances(context, points), allowed) > share
        return settled if better and settled.rms <= _AS_GOOD * self.rms + allowed else self

    def _squared_distances(self, context: SearchContext, points: FloatArray) -> FloatArray:
        """Of the images of points ``(n, 3)`` under the operations measured: ``(k, n)``."""
        return squared_distances(context.surface, points, self.measured_operations)

    def _placed(self, operations: Operations) -> Operations:
        points = np.empty((len(operations), 3))
        points[:] = self.centre
        return Operations(operations.directions @ self.frame, points, operations.angles, operations.improper)


def trivial() -> Hypothesis:
    """No symmetry at all, about the centroid of the surface: through it every exact element passes."""
    return Hypothesis(point_group("C1"), np.eye(3), np.zeros(3))


def _share_within(squared: FloatArray, distance: float) -> float:
    """The share of squared distances that are within a distance."""
    return float((squared < distance * distance).mean())


@lru_cache(maxsize=512)
def _chosen(group: PointGroup, most: int) -> Operations:
    """The generators of a group, each other element once while there are few, evenly picked ones of many.

    With the rotation half way round the principal axis, which a nearby wrong order (23 for 24) fails, and which says
    where the axis is.

    Args:
        group: in its own frame.
        most: operations altogether, unless there are more generators.
    """
    parts, order = [group.generators], group.principal_order
    if order > 2 and group.name[0] not in "TOI":
        angle = np.array([2.0 * np.pi * (order // 2) / order])
        parts.append(Operations.rotations(np.eye(3)[2], np.zeros(3), angle))
    operations, elements = Operations.joined(parts), _elements(group)
    same = np.abs(elements.matrices[:, None] - operations.matrices[None]).max((2, 3), initial=0.0) < _SAME_MATRIX
    others = elements[~same.any(1)]
    room = min(most - len(operations), len(others))
    if room <= 0:
        return operations
    chosen = np.unique(np.linspace(0, len(others) - 1, room).round().astype(int))
    return Operations.joined([operations, others[chosen]])


@lru_cache(maxsize=512)
def _elements(group: PointGroup) -> Operations:
    planes, axes = len(group.normals), len(group.directions)
    turns = np.array(
        [2.0 * np.pi / order if order else ARBITRARY_ANGLES[0] for order in group.orders], dtype=np.float64
    )
    return Operations(
        np.concatenate([group.normals, group.directions]),
        np.zeros((planes + axes, 3)),
        np.concatenate([np.zeros(planes), turns]),
        np.arange(planes + axes) < planes,
    )
