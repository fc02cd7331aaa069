"""From planes to the whole symmetry group: what they generate, what is still missing, and the verdict on all of it."""

import time

import numpy as np

from model.geometry.operations import Operations
from model.geometry.refinement import refine, squared_distances
from model.geometry.scan import minima
from model.search.axis_order import allowed_turns
from model.search.candidates import CUT, SAME_ANGLE, mean_errors, same_element, settle
from model.search.closure import LARGEST, LARGEST_APPROXIMATE
from model.search.group import Group
from model.search.judgement import CERTAIN_ERROR, EXACT_ERROR, tangents
from model.search.shape import PROMISING_AXIS, Shape
from model.symmetries import FoundAxis, FoundPlane, Reason, Symmetries, TurnedDown
from model.types import BoolArray, FloatArray

_MOST_AXES = 6
_PRODUCTS_EVERY, _PRODUCT_ERROR = 5, 4.0
"""New members of a group are checked on every fifth sample, against so many times the threshold of its generators."""

_WORSE, _PRECISE = 16.0, 2e-8
"""They may also not be so many times worse than these, or than the second figure."""

_HOPELESS_AXIS = 6.0
"""An axis whose first turn exceeds the threshold so many times is not refined."""

_SCREEN_PRIMES = (2, 3, 5, 7, 11, 13)
_AS_GOOD = 2.0
"""Where nothing is exact, what holds about as well as the best element, whatever that is, forms the group."""

_BASIN = float(np.deg2rad(6.0))
"""Nearer than this to a better element, a similar one is the same, not quite come to rest."""

_AZIMUTHS, _BEST_AZIMUTHS = 32, 4
_ACROSS = float(np.cos(np.deg2rad(8.0)))


class Completion:
    """From planes to the whole group: what they generate, then what is missing, then what the samples say.

    First with what is exact. Only if that leaves nothing, with what holds about as well as the best candidate does.
    """

    def __init__(
        self,
        shape: Shape,
        lines: FloatArray,
        scan: bool,
        planes: Operations,
        errors: FloatArray,
        rejected: list[TurnedDown],
    ) -> None:
        self._shape = shape
        self._lines = lines
        self._candidates, self._errors = planes, errors
        self._rejected = rejected
        self._level = min(EXACT_ERROR, shape.max_error)
        self._approximate = False
        self._half_turns_due = scan
        self._tested: list[FloatArray] = []
        self._group = Group.generated(planes[:0], errors[:0], shape.centre)

    def exact(self) -> bool:
        """Complete the group of what is exact; True if there is anything."""
        self._complete()
        return len(self._group.matrices) > 1

    def result(self) -> Symmetries:
        """The group of `exact`, or where that is trivial the one of what holds best, and the verdict on it."""
        if len(self._group.matrices) == 1:
            self._approximate = True
            self._tested.clear()
            if len(self._errors):
                self._level = min(max(self._level, _AS_GOOD * float(self._errors.min())), self._shape.max_error)
            self._complete()
        started = time.perf_counter()
        result = self._judged()
        result.judging_ms = (time.perf_counter() - started) * 1e3
        return result

    def _complete(self) -> None:
        self._extend(self._candidates, self._errors)
        self._raise_orders()
        if self._half_turns_due:
            self._half_turns_due = False
            operations, errors = self._half_turns()
            self._candidates = Operations.joined([self._candidates, operations])
            self._errors = np.concatenate([self._errors, errors])
            if self._extend(operations, errors):
                self._raise_orders()
        self._add_along()
        self._add_cubic()
        self._add_improper()

    def _extend(self, operations: Operations, errors: FloatArray) -> bool:
        """Add those that hold to the group; True if it has grown."""
        good = np.flatnonzero(errors <= self._level).tolist()
        good = [k for k in good if errors[k] < CERTAIN_ERROR or self._stands_out(operations[[k]], float(errors[k]))]
        if not good:
            return False
        largest = LARGEST_APPROXIMATE if self._approximate else LARGEST
        grown = self._group.with_operations(operations[good], errors[good], largest, self._all_hold)
        larger = len(grown.matrices) > len(self._group.matrices)
        if larger:
            self._group = grown
        return larger

    def _all_hold(self, operations: Operations, error: float) -> bool:
        """Whether the shape has all these: the product of two symmetries errs four times as much as each at worst.

        On nearly round shapes everything is nearly exact: what planes of a small ``error`` bring in must be good too.
        """
        errors = mean_errors(self._shape.surface, self._shape.samples[::_PRODUCTS_EVERY], operations)
        bound = min(_PRODUCT_ERROR, _WORSE * max(error, _PRECISE) / self._level) * self._level
        return bool(errors.max(initial=0.0) <= bound)

    def _stands_out(self, operation: Operations, error: float, *, beside_others: bool = False) -> bool:
        whole = beside_others and not self._approximate
        stands_out = self._shape.judge.stands_out(operation, beside_others=beside_others, whole=whole)
        if not stands_out:
            self._reject(operation, error, "look_alike")
        return stands_out

    def _reject(self, operation: Operations, error: float, reason: Reason) -> None:
        if operation.improper[0] and operation.angles[0] == 0.0:
            self._rejected.append(TurnedDown(error, reason, operation.planes[0]))
        elif not operation.improper[0]:  # neither centres nor rotoreflections are elements that a client knows
            direction, point = operation.directions[0], operation.points[0]
            self._rejected.append(TurnedDown(error, reason, direction=direction, point=point))

    def _raise_orders(self) -> None:
        """Look for higher orders about every axis known so far, until there is none."""
        while True:
            normals, directions, orders = self._group.elements
            candidates = np.concatenate([directions, normals, self._lines])
            for index, direction in enumerate(candidates):
                # One of each set of equivalent axes is enough.
                images = self._group.matrices @ direction
                if any(np.abs(images @ other).max() > np.cos(2.0 * SAME_ANGLE) for other in self._tested):
                    continue
                self._tested.append(direction)
                order = orders[index] if index < len(orders) else 1  # the group's own axes come first
                if self._raise_order(direction, order):
                    break
            else:
                return

    def _raise_order(self, direction: FloatArray, order: int) -> bool:
        shape = self._shape
        centre = self._group.centre
        turns = 2.0 * np.pi / np.array(_SCREEN_PRIMES, dtype=np.float64)
        starts = Operations.rotations(np.tile(direction, (len(turns), 1)), centre, turns)
        scores = shape.scores(starts)
        if order > 1:
            scores[[n == order for n in _SCREEN_PRIMES]] = np.inf
        if scores.min() > PROMISING_AXIS:
            return False
        best = int(np.argmin(scores))
        first = squared_distances(shape.surface, shape.samples[::6], starts[[best]])
        if np.minimum(first, CUT * CUT).mean() > _HOPELESS_AXIS * shape.max_error:
            return False
        axis = refine(shape.surface, shape.points(3), starts[[best]], 8, scale=0.03)
        error = float(mean_errors(shape.surface, shape.samples, axis)[0])
        if error > shape.max_error:
            self._reject(axis, error, "not_symmetric")
            return False
        limit = self._limit(error)
        found = allowed_turns(
            shape.surface,
            shape.samples[::3],
            axis.directions[0],
            axis.points[0],
            limit=limit,
            max_error=shape.max_error,
        )
        if found.order is None or found.order <= order:
            return False
        angle = 2.0 * np.pi / found.order
        generator = Operations.rotations(axis.directions, axis.points, angle)
        if order > 1:  # the group knows where this axis is, on thin shapes better than any samples do
            known = Operations.rotations(direction, centre, angle)
            errors = mean_errors(shape.surface, shape.samples, Operations.joined([known, generator]))
            if errors[0] <= max(errors[1], CERTAIN_ERROR):
                generator = known
        return self._add(generator)

    def _limit(self, error: float) -> float:
        """The largest SDE of what joins the group; the first approximate member sets it."""
        if not self._approximate or len(self._group.generators):
            return self._level
        return min(max(self._level, _AS_GOOD * error), self._shape.max_error)

    def _add(self, operation: Operations) -> bool:
        """Add one refined operation if it holds; True if the group has grown."""
        errors = mean_errors(self._shape.surface, self._shape.samples, operation)
        self._level = self._limit(float(errors[0]))
        return self._extend(operation, errors)

    def _half_turns(self) -> tuple[Operations, FloatArray]:
        """Two-fold axes that the scan sees and the group lacks, refined, and their errors."""
        shape = self._shape
        _, turned = shape.grid.scan
        directions = minima(turned, _MOST_AXES, PROMISING_AXIS) @ shape.turn
        starts = Operations.rotations(directions, self._group.centre, np.pi)
        near = self._group.elements.directions
        if len(near):
            starts = starts[np.flatnonzero(np.abs(starts.directions @ near.T).max(1) < _ACROSS)]
        settled = settle(shape.surface, shape.points, shape.samples, starts, shape.max_error)
        good = settled.errors <= shape.max_error
        return settled.operations[good], settled.errors[good]

    def _add_along(self) -> None:
        """Planes through the principal axis and two-fold axes across it, which the scan misses on nearly round shapes.

        Both repeat with the period pi / n about an axis of order n: of many azimuths within one the best are refined.
        """
        normals, lines, orders = self._group.elements
        if not orders or len(lines) > 1:
            return
        main, centre = lines[0], self._group.centre
        if len(normals) and np.abs(normals @ main).min() < 0.1:
            return
        first, second = tangents(main)
        angles = np.pi / orders[0] * np.arange(_AZIMUTHS) / _AZIMUTHS
        sides = np.cos(angles)[:, None] * first + np.sin(angles)[:, None] * second
        planes = Operations.reflections(np.column_stack([sides, -sides @ centre]))
        turns = Operations.rotations(sides, centre, np.pi)
        shape = self._shape
        starts = [
            kind[np.argsort(mean_errors(shape.surface, shape.samples[::5], kind), kind="stable")[:_BEST_AZIMUTHS]]
            for kind in (planes, turns)
        ]
        found = settle(shape.surface, shape.points, shape.samples, Operations.joined(starts), shape.max_error)
        if self._extend(found.operations, found.errors):
            self._raise_orders()

    def _add_cubic(self) -> None:
        """Three perpendicular two-fold axes and nothing higher may be the half of a tetrahedral group."""
        directions, orders = self._group.elements.directions, self._group.elements.orders
        if orders == (2, 2, 2):
            diagonal = directions.sum(0) / np.sqrt(3.0)
            self._refine_and_add(Operations.rotations(diagonal, self._group.centre, 2.0 * np.pi / 3.0))

    def _add_improper(self) -> None:
        """Inversion, and the rotoreflection by half the smallest turn: they leave neither a plane nor an axis."""
        lines, orders = self._group.elements.directions, self._group.elements.orders
        centre = self._group.centre[None]
        improper = np.ones(1, dtype=np.bool_)
        for line, order in zip(lines, orders, strict=True):
            half = Operations(line[None], centre, np.array([np.pi / order]), improper)
            if order == max(orders) and self._tells_angles_apart(half):
                self._refine_and_add(half)
        self._refine_and_add(Operations(np.array([[0.0, 0.0, 1.0]]), centre, np.array([np.pi]), improper))

    def _tells_angles_apart(self, operation: Operations) -> bool:
        """Whether another angle about the same line would be distinctly worse: not on a needle, for example."""
        angles = np.concatenate([operation.angles, operation.angles[0] * np.array([0.5, 1.5])])
        others = operation[[0, 0, 0]]
        others = Operations(others.directions, others.points, angles, others.improper)
        errors = mean_errors(self._shape.surface, self._shape.samples[::2], others)
        return bool(errors[0] < max(CERTAIN_ERROR, 0.1 * errors[1:].min()))

    def _refine_and_add(self, operation: Operations) -> None:
        shape = self._shape
        if not self._group.holds(operation)[0] and shape.scores(operation)[0] <= PROMISING_AXIS:
            self._add(refine(shape.surface, shape.points(2), operation, 10, scale=0.03))

    def _judged(self) -> Symmetries:
        shape = self._shape
        result = Symmetries(rejected=self._rejected)
        group = self._group
        while True:
            normals, _, orders = group.elements
            members = group.element_operations
            errors, safe = shape.judge.errors(members)
            if safe.all() or not len(group.generators):
                break
            if self._approximate:
                members, errors, safe = self._polished(members, errors, safe)
                if safe.all():
                    break
            self._reject(group.generators[[int(np.argmax(group.errors))]], float(group.errors.max()), "not_symmetric")
            group = group.without_worst()
        result.point_group = group.name
        for k in range(len(normals)):
            result.planes.append(FoundPlane(members.planes[k], float(errors[k])))
        for k in range(len(normals), len(members)):
            order = orders[k - len(normals)]
            result.axes.append(FoundAxis(members.directions[k], members.points[k], order, float(errors[k])))
        self._append_similar(result, group, members)
        return result

    def _polished(
        self, members: Operations, errors: FloatArray, safe: BoolArray
    ) -> tuple[Operations, FloatArray, BoolArray]:
        """Members of an approximate group, each moved to where it fits best by itself."""
        refined = refine(self._shape.surface, self._shape.points(1), members, 6, scale=0.01)
        new_errors, new_safe = self._shape.judge.errors(refined)
        better = new_errors < errors
        directions = np.where(better[:, None], refined.directions, members.directions)
        points = np.where(better[:, None], refined.points, members.points)
        members = Operations(directions, points, members.angles, members.improper)
        return members, np.where(better, new_errors, errors), np.where(better, new_safe, safe)

    def _append_similar(self, result: Symmetries, group: Group, members: Operations) -> None:
        """What holds within the threshold, but less well than the group: with all its images, or not at all."""
        listed: list[Operations] = []
        for k in np.flatnonzero(~group.holds(self._candidates)).tolist():
            operation, error = self._candidates[[k]], float(self._errors[k])
            known = Operations.joined([operation, members, *listed])
            if any(same_element(known, 0, i, _BASIN) for i in range(1, len(known))):
                continue
            if not self._stands_out(operation, error, beside_others=True):
                continue
            images = group.images(operation)
            errors, safe = self._shape.judge.errors(images)
            if not safe.all():
                self._reject(operation, float(errors.max()), "not_symmetric")
                continue
            for i in range(len(images)):
                listed.append(images[[i]])
                if images.improper[i]:
                    result.planes.append(FoundPlane(images.planes[i], float(errors[i])))
                else:
                    result.axes.append(FoundAxis(images.directions[i], images.points[i], 2, float(errors[i])))
