"""Full mode: every symmetry of a shape, refined, completed to a group, judged on samples that refined nothing.

The paper stops at three approximate planes (section 5) and names the rest as open. Here the network's output is one
source of starts among others; what decides is geometry. In order: surfaces of revolution; planes; the group that they
generate; orders about its axes; two-fold axes and improper operations still missing; judgement.
"""

import time
from dataclasses import dataclass

import numpy as np

from model.axis_order import ARBITRARY_ANGLES, SPHERE_DEVIATION, Turns, allowed_turns
from model.candidates import CUT, SAME_ANGLE, mean_errors, same_element, settle
from model.closure import LARGEST, LARGEST_APPROXIMATE
from model.group import Group
from model.judgement import CERTAIN_ERROR, EXACT_ERROR, Judge, tangents
from model.operations import Operations
from model.proposals import Proposals
from model.refinement import refine, squared_distances
from model.scan import DistanceGrid, directions, minima
from model.surface import SurfaceIndex
from model.symmetries import FoundAxis, FoundPlane, Reason, Symmetries, TurnedDown
from model.types import BoolArray, FloatArray

_PROMISING_PLANE, _PROMISING_AXIS = 1.5, 0.7
"""Scores of the scan, in squared voxels, above which nothing is worth refining. Clear planes score below 0.5; a missing
part adds nine times its share of the surface."""

_MOST_PLANES, _MOST_AXES = 14, 6
_MOST_THROUGH_ROUND = 3
_EVERY_DIRECTION = 12
_MOST_CANDIDATES = 24
_PRODUCTS_EVERY, _PRODUCT_ERROR = 5, 4.0
_HOPELESS_AXIS = 6.0
_SCREEN_PRIMES = (2, 3, 5, 7, 11, 13)
_AS_GOOD = 2.0
"""Elements that hold about as well as the best one, whatever that is, form the group."""

_BASIN = float(np.deg2rad(6.0))
"""Nearer than this to a better element, a similar one is the same, not quite come to rest."""

_ALONG, _ACROSS = float(np.sin(np.deg2rad(4.0))), float(np.cos(np.deg2rad(8.0)))


@dataclass(frozen=True, slots=True)
class Sources:
    """Where the starts come from: for ablations."""

    network: bool = True
    inertia: bool = True
    scan: bool = True


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


def find_symmetries(shape: Shape, proposals: Proposals | None, sources: Sources) -> Symmetries:
    """All planes and axes of a shape in the unit frame.

    Args:
        shape: what to search.
        proposals: the network's output, used where ``sources`` says so.
        sources: of starts.
    """
    lines = _lines(shape, proposals, sources)
    round_lines: list[FloatArray] = []
    roughly: list[FloatArray] = []
    for direction in lines:
        point, turns = _inspect(shape, direction)
        if turns.order is None and turns.exact:
            return _revolution(shape, point[:3], point[3:])
        if turns.order is None:
            roughly.append(point)
        if turns.round_within:
            round_lines.append(point[:3])
    starts = _plane_starts(shape, proposals, sources, round_lines)
    planes = settle(shape.surface, shape.points, shape.samples, starts, shape.max_error)
    found, errors = planes.operations, planes.errors
    within = errors <= shape.max_error  # sorted: the first of them are the best
    rejected = [
        TurnedDown(error, "not_symmetric", plane)
        for part, part_errors in ((planes.dropped, planes.dropped_errors), (found[~within], errors[~within]))
        for plane, error in zip(part.planes, part_errors.tolist(), strict=True)
    ]
    completion = _Completion(
        shape, lines, sources, found[within][:_MOST_CANDIDATES], errors[within][:_MOST_CANDIDATES], rejected
    )
    exact = completion.exact()
    if roughly and not exact:  # a vase as scanned; what is exact would say more
        return _revolution(shape, roughly[0][:3], roughly[0][3:])
    return completion.result()


def _lines(shape: Shape, proposals: Proposals | None, sources: Sources) -> FloatArray:
    """Directions through the centre that may be axes of high order: ``(k, 3)``, each once."""
    candidates = [shape.principal] if sources.inertia else []
    if sources.network and proposals is not None:
        candidates.append(proposals.directions)
    kept: list[FloatArray] = []
    for direction in np.concatenate([np.zeros((0, 3)), *candidates]):
        if not any(abs(direction @ other) > np.cos(np.deg2rad(5.0)) for other in kept):
            kept.append(direction)
    return np.reshape(kept, (-1, 3))


def _inspect(shape: Shape, direction: FloatArray) -> tuple[FloatArray, Turns]:
    """Whether the shape is round about an axis near ``direction``: the refined axis ``(6,)`` and what it allows."""
    start = np.concatenate([direction, shape.centre])
    count = len(ARBITRARY_ANGLES)
    turned = Operations.rotations(np.tile(direction, (count, 1)), shape.centre, ARBITRARY_ANGLES)
    if shape.scores(turned).max() > _PROMISING_AXIS:
        return start, Turns(1, False)
    axis = refine(shape.surface, shape.points(3), turned[:1], 8, scale=0.05)
    point, few = np.concatenate([axis.directions[0], axis.points[0]]), shape.samples[::2]
    limit = EXACT_ERROR
    return point, allowed_turns(shape.surface, few, point[:3], point[3:], limit=limit, max_error=shape.max_error)


def _plane_starts(
    shape: Shape, proposals: Proposals | None, sources: Sources, round_lines: list[FloatArray]
) -> Operations:
    normals: list[FloatArray] = [np.zeros((0, 3))]
    if sources.inertia:
        normals.append(shape.principal)
    if sources.scan:
        mirrored, _ = shape.grid.scan
        scanned = minima(mirrored, _MOST_PLANES, _PROMISING_PLANE) @ shape.turn
        if len(round_lines) > 1:  # nearly a sphere: the scan sees nothing
            scanned = directions()[::_EVERY_DIRECTION]
        if len(round_lines) == 1:  # about a nearly round axis all planes look alike to the scan: a few are enough
            through = np.abs(scanned @ round_lines[0]) < 2.0 * _ALONG
            scanned = np.concatenate([scanned[through][:_MOST_THROUGH_ROUND], scanned[~through]])
        normals.append(scanned)
    rows = np.concatenate(normals)
    starts = np.column_stack([rows, -rows @ shape.centre])
    if sources.network and proposals is not None:
        starts = np.concatenate([proposals.planes, starts])
    return Operations.reflections(starts)


def _revolution(shape: Shape, direction: FloatArray, point: FloatArray) -> Symmetries:
    """A surface of revolution: the axis, what lies across it, and two planes through it for all of them."""
    across = settle(
        shape.surface,
        shape.points,
        shape.samples,
        Operations.reflections(np.append(direction, -direction @ shape.centre)),
        shape.max_error,
    )
    first, second = tangents(direction)
    has_plane = len(across.errors) > 0
    centre = point + direction * (direction @ (shape.centre - point))
    if has_plane:
        plane = across.operations.planes[0]
        centre = centre - direction * ((plane[:3] @ centre + plane[3]) / (plane[:3] @ direction))
    if has_plane and all(_round(shape, side, centre) for side in (first, second)):
        axes = [direction, first, second]
        name = "Kh"
    else:
        axes = [direction]
        name = "Dinfh" if has_plane else "Cinfv"
    through = [first, second, direction] if name == "Kh" else [first, second]
    planes = [np.append(normal, -normal @ centre) for normal in through]
    if name == "Dinfh":
        planes.append(across.operations.planes[0])
    errors, safe = shape.judge.errors(Operations.reflections(np.stack(planes)))
    result = Symmetries(point_group=name)
    for index, (plane, error) in enumerate(zip(planes, errors, strict=True)):
        if safe[index]:
            result.planes.append(FoundPlane(plane, float(error), continuous=index < len(through)))
        elif index == len(through):
            result.point_group = "Cinfv"
    turns = Operations.rotations(np.stack(axes), centre, float(ARBITRARY_ANGLES[0]))
    errors, safe = shape.judge.errors(turns)
    for axis, error, holds in zip(axes, errors, safe, strict=True):
        if holds:
            result.axes.append(FoundAxis(axis, centre, None, float(error)))
    return result


def _round(shape: Shape, direction: FloatArray, centre: FloatArray) -> bool:
    turns = allowed_turns(
        shape.surface,
        shape.samples[::2],
        direction,
        centre,
        limit=EXACT_ERROR,
        max_error=shape.max_error,
        deviation=SPHERE_DEVIATION,
    )
    return turns.order is None


class _Completion:
    """From planes to the whole group: what they generate, then what is missing, then what the samples say.

    First with what is exact. Only if that leaves nothing, with what holds about as well as the best candidate does.
    """

    def __init__(
        self,
        shape: Shape,
        lines: FloatArray,
        sources: Sources,
        planes: Operations,
        errors: FloatArray,
        rejected: list[TurnedDown],
    ) -> None:
        self._shape = shape
        self._lines = lines
        self._sources = sources
        self._candidates, self._errors = planes, errors
        self._rejected = rejected
        self._level = min(EXACT_ERROR, shape.max_error)
        self._approximate = False
        self._scanned = False
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
        if self._sources.scan and not self._scanned:
            self._scanned = True
            operations, errors = self._half_turns()
            self._candidates = Operations.joined([self._candidates, operations])
            self._errors = np.concatenate([self._errors, errors])
            if self._extend(operations, errors):
                self._raise_orders()
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

    def _all_hold(self, operations: Operations) -> bool:
        """Whether the shape has all these: the product of two symmetries errs four times as much as each at worst."""
        errors = mean_errors(self._shape.surface, self._shape.samples[::_PRODUCTS_EVERY], operations)
        return bool(errors.max(initial=0.0) <= _PRODUCT_ERROR * self._level)

    def _stands_out(self, operation: Operations, error: float, *, beside_others: bool = False) -> bool:
        stands_out = self._shape.judge.stands_out(operation, beside_others=beside_others)
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
            known = dict.fromkeys(range(len(directions)))
            candidates = np.concatenate([directions, normals, self._lines])
            for index, direction in enumerate(candidates):
                # One of each set of equivalent axes is enough.
                images = self._group.matrices @ direction
                if any(np.abs(images @ other).max() > np.cos(2.0 * SAME_ANGLE) for other in self._tested):
                    continue
                self._tested.append(direction)
                order = orders[index] if index in known else 1
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
        if scores.min() > _PROMISING_AXIS:
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
        return self._add(Operations.rotations(axis.directions, axis.points, 2.0 * np.pi / found.order))

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
        directions = minima(turned, _MOST_AXES, _PROMISING_AXIS) @ shape.turn
        starts = Operations.rotations(directions, self._group.centre, np.pi)
        near = self._group.elements.directions
        if len(near):
            starts = starts[np.flatnonzero(np.abs(starts.directions @ near.T).max(1) < _ACROSS)]
        settled = settle(shape.surface, shape.points, shape.samples, starts, shape.max_error)
        good = settled.errors <= shape.max_error
        return settled.operations[good], settled.errors[good]

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
        if not self._group.holds(operation)[0] and shape.scores(operation)[0] <= _PROMISING_AXIS:
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
