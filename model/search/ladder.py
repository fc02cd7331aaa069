"""The ladder of symmetry groups of a shape: each holds more, and needs more tolerance, than the one before.

Candidates are taken by rising deviation. Each that fits the group found so far makes it grow; a group is fitted to all
its elements together, and measured as a whole. What the grown group suggests is tried as well: higher orders of its
axes, planes and half turns that go with them, the cubic groups.
"""

from collections.abc import Iterator

import numpy as np

from model.geometry.operations import Operations
from model.geometry.refinement import START_SCALE, refine
from model.search.axis_order import PRIMES, is_symmetric, prime_rotations, rotation_order
from model.search.context import SearchContext
from model.search.extensions import azimuths, turned_to_best, with_axis
from model.search.hypothesis import Hypothesis, trivial
from model.search.lines import PARALLEL, common_point, distances_from, distinct_lines
from model.search.point_groups import ARBITRARY_ANGLES, point_group
from model.search.supergroups import EXACT_ANGLE, ROUGH_ANGLE, generated, supergroups
from model.search.tilting import tilted
from model.types import FloatArray

_SCREEN_ORDERS = (2, 3, 4, 5, 6, 7, 8, 10, 11, 12, 13)
_LARGEST_CLOSED = 260
_HOPELESS, _NEARLY, _BARELY = 4.0, 2.0, 0.8
_GLANCE_STRIDE = 3
_IMPLAUSIBLE_CLOSED, _IMPLAUSIBLE = 2.0, 4.0
"""Scores of voxels, see `SearchContext.scores`, above which a hypothesis is not measured, of closed and open surfaces:
those that held in the end had half as much at most where little was missing, and less where a third or more was."""

_NOISIER = 1.25
"""The noise of a larger group, the largest of more operations on fewer samples each, may seem so many times larger."""

_AGAIN = 1.2
"""What failed is tried again when the tolerance is so many times larger."""

_NEARER, _LATER = 0.7, 3.0
"""What needs more tolerance is tried again at this part of it, a better place being found by then, or at so many times
the tolerance of now."""


class Ladder:
    """Builds the groups of a shape, the finest first.

    ``rungs``: the non-trivial groups found so far. ``round_lines``: directions and points of axes about which the shape
    is round, at least roughly.
    """

    def __init__(self, context: SearchContext, lines: FloatArray, *, holed: bool) -> None:
        """Start with no symmetry; ``lines`` ``(k, 3)`` are directions through the centre that may be axes.

        Where neither planes nor half turns are found, or the surface may be ``holed``, more are looked for: an axis of
        odd order may be off the axes of inertia, which what is missing tilts, and so does a detail.
        """
        self._context = context
        self._holed = holed
        self._lines = lines
        self._group = trivial()
        self._failed: dict[tuple[object, ...], float] = {}
        self._known: dict[tuple[object, ...], Operations] = {}
        self._noise = (self._group, 0.0)
        self.rungs: list[Hypothesis] = []
        self.round_lines: list[tuple[FloatArray, FloatArray]] = []

    def climb(self, candidates: Operations, costs: FloatArray) -> None:
        """Take in candidates ``(k,)`` by rising ``costs`` ``(k,)``, precise ones in batches, others one by one."""
        settings, limit = self._context.settings, self._context.limit
        needed = costs.copy()  # the tolerance that each is tried at next
        for precision in (settings.file_precision, settings.modelling_precision, settings.feature_precision):
            tolerance = min(precision, limit)
            grown = False
            for index in np.argsort(needed, kind="stable")[: int((needed <= tolerance).sum())].tolist():
                needed[index] = self._add(candidates[[index]], tolerance)
                grown |= needed[index] <= tolerance
            needed[needed <= tolerance] = np.inf
            # Beyond modelling precision, what an exact group suggests is a candidate by itself.
            exact = self._group.name != "C1" and self._group.rms <= settings.file_precision
            if grown or not exact or precision <= settings.modelling_precision:
                self._extend(tolerance)
            self._note()
            if precision == settings.modelling_precision and self._group.name != "C1":
                # The teeth of a gear, before facets of its bore let another order hold as roughly.
                self._raise_order(min(settings.feature_precision, limit), nearly_round=True)
                self._note()
        if self._group.name in ("C1", "Ci") or (self._holed and self._group.group.principal_order < 3):
            self._lines = distinct_lines(np.concatenate([self._lines, self._context.odd_lines()]))
        for index in np.argsort(needed, kind="stable")[: int((needed <= limit).sum())].tolist():
            if self._context.is_spent:
                break
            least = max(float(needed[index]), settings.feature_precision / settings.growth)
            if self._group.name == "C1" and self._grows(least):
                self._note()  # an axis that fits better than any plane or half turn comes before them
            tolerance = self._beyond(max(float(needed[index]), self._group.rms))
            if self._add(candidates[[index]], tolerance) <= tolerance:
                self._extend(self._beyond(self._group.rms))
                self._note()

    def extend_roughly(self) -> None:
        """Look for what no candidate shows, as roughly as what there is allows.

        Where nothing is exact that is much. A group that is exact may still be a part of one about the same axis that
        facets elsewhere, of a bore, say, keep from being exact.
        """
        settings, limit = self._context.settings, self._context.limit
        if self._group.name == "C1" and self._grows(limit):
            self._note()  # what it is a part of may be much rougher
        rough = self._beyond(self._group.rms)
        exact = self._group.rms <= settings.file_precision
        if self._group.name != "C1" and (not exact or self._raise_order(rough, nearly_round=True)):
            self._extend(rough)
        self._note()

    def _beyond(self, rms: float) -> float:
        """The tolerance for what extends a group with an RMS deviation: so many times larger, but for its noise.

        Noise does not add up, as deviations of a shape do: a larger group has no more of it.
        """
        settings, context = self._context.settings, self._context
        if self._noise[0] is not self._group:
            precise = self._group.rms <= settings.modelling_precision
            self._noise = self._group, 0.0 if precise else self._group.noise(context)
        noise = min(self._noise[1], rms)
        shape = max(float(np.sqrt(rms**2 - noise**2)), settings.feature_precision / settings.growth)
        return min(float(np.hypot(_NOISIER * noise, settings.growth * shape)), context.limit)

    def _note(self) -> None:
        if self._group.name != "C1" and (not self.rungs or self.rungs[-1] is not self._group):
            self.rungs.append(self._group)

    def _add(self, operation: Operations, tolerance: float) -> float:
        """Let the group grow by one operation, if what they generate together holds within a tolerance.

        Returns:
            the tolerance it needs: at most ``tolerance`` if the group has grown, infinite if it never will by this.
        """
        group, settings = self._group, self._context.settings
        precise = tolerance <= settings.modelling_precision
        angle = EXACT_ANGLE if precise else ROUGH_ANGLE
        if group.contains(operation, angle, settings.same_distance)[0] or group.group.size > _LARGEST_CLOSED:
            return np.inf
        members = Operations.joined([group.generators, operation])
        identified = generated(members, precise=precise)
        centre = common_point(members, group.centre)
        if identified is None or distances_from(members, centre).max() > settings.same_distance:
            return settings.growth * tolerance
        name, frame = identified
        if name == group.name:
            return np.inf  # it stands beside one of the group's own elements, which holds better: nothing grows
        hypothesis = Hypothesis(point_group(name), frame, centre)
        # By which angles planes stand to each other is only known roughly if they are rough.
        return self._try(hypothesis, tolerance, sceptically=not precise)

    def _try(
        self,
        hypothesis: Hypothesis,
        tolerance: float,
        key: tuple[object, ...] | None = None,
        *,
        sceptically: bool = False,
    ) -> float:
        """Fit a hypothesis and take it if it holds; the tolerance it needs, which is remembered by its ``key``.

        Looked at sceptically, the order of its axis has to be better than no order.
        """
        order = hypothesis.group.principal_order
        if tolerance > self._context.settings.modelling_precision and order > max(2, self._group.group.principal_order):
            hypothesis = turned_to_best(self._context, hypothesis)
        fitted, needed = self._fitted(hypothesis, tolerance)
        if needed <= tolerance and sceptically and not self._turns(fitted):
            needed = np.inf
        if needed <= tolerance:
            self._group = fitted
        elif key is not None:
            self._needs(key, needed, tolerance)
        return needed

    def _fitted(self, hypothesis: Hypothesis, tolerance: float) -> tuple[Hypothesis, float]:
        """A hypothesis where it fits best, and the tolerance it needs to be taken: infinite if it is not believed."""
        context = self._context
        if context.scores(hypothesis.generators, self._implausible).max() > self._implausible:
            return hypothesis, np.inf
        if not context.meter.closed:  # what is missing decides how it is fitted
            hypothesis = hypothesis.measured(context, stride=_GLANCE_STRIDE)
            if hypothesis.rms > _HOPELESS * context.limit:
                return hypothesis, np.inf
        fitted = hypothesis.fitted(context)
        barely = _BARELY * context.settings.least_coverage <= fitted.coverage < context.settings.least_coverage
        if barely or tolerance < fitted.rms <= _NEARLY * tolerance:
            fitted = fitted.measured(context, thoroughly=True)  # of few samples one may decide by chance
        # The first rough symmetry has no other to bear it out: it must not be one of many that do as well.
        rough = self._group.name == "C1" and fitted.rms > context.settings.feature_precision
        if not fitted.is_believed(context.settings) or (
            fitted.rms <= tolerance and rough and not self._is_distinct(fitted)
        ):
            return fitted, np.inf
        return fitted, fitted.rms

    def _turns(self, hypothesis: Hypothesis) -> bool:
        """Whether a new order of a hypothesis' axis is distinctly better than arbitrary rotations about it."""
        context, order = self._context, hypothesis.group.principal_order
        if order in (1, 2, self._group.group.principal_order) or hypothesis.name[0] in "TOIK":
            return True
        return is_symmetric(
            context.meter,
            context.judging,
            hypothesis.axis,
            hypothesis.centre,
            order,
            limit=context.limit,
            many=lambda: context.many,
            settings=context.settings,
        )

    @property
    def _implausible(self) -> float:
        """Score of voxels above which a hypothesis is not measured."""
        return _IMPLAUSIBLE_CLOSED if self._context.meter.closed else _IMPLAUSIBLE

    def _is_distinct(self, hypothesis: Hypothesis) -> bool:
        """Whether the group fits distinctly better than the same one tilted, either way: else the shape is a lump."""
        context, element = self._context, hypothesis.generators[[0]]
        both = Operations.joined([element, tilted(element, context.settings.tilt)])
        # Who raises the threshold is told of what is as rough as that: distances up to it must count.
        cut = max(context.settings.truncation, 1.5 * context.limit) ** 2
        squared = np.minimum(context.meter.measure(both, context.judging.every(2)).squared, cut).mean(1)
        return bool(squared[1:].min() > context.settings.tilt_factor * squared[0])

    def _was_tried(self, key: tuple[object, ...], tolerance: float) -> bool:
        """Whether something was tried at about this tolerance or a larger one before; from now on it was."""
        if _AGAIN * self._failed.get(key, -1.0) >= tolerance:
            return True
        self._failed[key] = tolerance
        return False

    def _needs(self, key: tuple[object, ...], rms: float, tolerance: float) -> None:
        """Do not try again what deviated by ``rms`` where it was tried, until the tolerance comes near to that."""
        self._failed[key] = max(self._failed[key], min(_NEARER * rms, _LATER * tolerance))

    def _extend(self, tolerance: float) -> None:
        """Try what the group suggests, until nothing more holds."""
        while self._grows(tolerance):
            pass

    def _grows(self, tolerance: float) -> bool:
        """Try what the group suggests; True if something held. What is already found has to be judged as well."""
        if self._context.is_spent:
            return False
        return self._raise_order(tolerance) or any(
            self._try(hypothesis, tolerance, key) <= tolerance for hypothesis, key in self._suggested(tolerance)
        )

    def _raise_order(self, tolerance: float, *, nearly_round: bool = False) -> bool:
        """Look for a higher order about each axis known or suspected; True if there was one."""
        group = self._group
        if group.name[0] in "TOI":
            return False
        known = group.directions[np.argsort([-order for order in group.group.orders], kind="stable")]
        tried: list[FloatArray] = []
        for line in distinct_lines(np.concatenate([known, group.group.normals @ group.frame, self._lines])):
            # One of each set of lines that the group maps onto each other is enough.
            images = group.matrices @ line
            if any(np.abs(images @ other).max() > PARALLEL for other in tried):
                continue
            tried.append(line)
            if nearly_round and not self._is_nearly_round(line):
                continue
            if self._raise_order_about(line, tolerance, past_facets=nearly_round):
                return True
        return False

    def _is_nearly_round(self, line: FloatArray) -> bool:
        rotations = Operations.rotations(line, self._group.centre, ARBITRARY_ANGLES)
        promising = self._context.settings.promising_exact
        return bool(self._context.scores(rotations, promising).max() <= promising)

    def _raise_order_about(self, line: FloatArray, tolerance: float, *, past_facets: bool = False) -> bool:
        context, group = self._context, self._group
        parallel = np.abs(group.directions @ line) > PARALLEL
        order = int(np.array(group.group.orders)[parallel].max()) if parallel.any() else 1
        key = ("order", order, past_facets, *np.round(np.abs(line), 2).tolist())
        if self._was_tried(key, tolerance):
            return False
        turns = 2.0 * np.pi / np.array([n for n in _SCREEN_ORDERS if order % n])
        starts = Operations.rotations(line, group.centre, turns)
        closed, some = context.meter.closed, context.settings.promising_axis
        promising = context.settings.promising_exact if closed else some
        scores = context.scores(starts, promising)
        best = int(np.argmin(scores))
        precise = tolerance <= context.settings.modelling_precision
        if scores[best] > promising:
            return False
        primes = PRIMES[context.scores(prime_rotations(line, group.centre), some) <= some]
        if order == 1 and primes.max(initial=2) == 2:
            return False  # half turns are candidates already
        direction, point = line, group.centre
        # Of a shape that is round but for its teeth few samples do not tell orders apart.
        few = precise and not past_facets and not self._is_nearly_round(line)
        samples = context.samples.every(3) if few else context.judging
        tried = {order, 1}
        # The axis may be where the line is. Else it is near the one that fits best, which another angle than its own
        # was fitted to: there its order may only show roughly.
        rough = max(tolerance, context.settings.feature_precision)
        limits = [rough, rough, tolerance] if order == 1 else [tolerance]
        needed = np.inf
        for attempt, limit in enumerate(limits):
            if attempt == 1:
                axis = self._refined(starts[[best]], 8, 0.05)
                direction, point = axis.directions[0], axis.points[0]
            found = rotation_order(
                context.meter,
                samples,
                direction,
                point,
                limit=limit,
                known=order,
                primes=primes,
                past_facets=past_facets,
                many=None if precise else lambda: context.many,
                settings=context.settings,
            )
            if found.arbitrary_rms <= context.limit:
                self._note_round(direction, point)
            needed = min(needed, found.needed)
            if found.order == 1 and attempt:
                break
            if found.order is None or found.order in tried:
                continue
            tried.add(found.order)
            angle = 2.0 * np.pi / found.order
            suggestion = with_axis(group, direction, point, found.order)
            if suggestion is not None and self._try(suggestion, tolerance) <= tolerance:
                return True
            rotation = Operations.rotations(direction, point, angle)
            if suggestion is None and self._add(rotation, tolerance) <= tolerance:
                return True
            axis = self._refined(rotation, 8, 0.02)
            direction, point = axis.directions[0], axis.points[0]
        if len(tried) == len({order, 1}):
            self._needs(key, needed, limits[0])
        return False

    def _refined(self, operation: Operations, steps: int, scale: float = START_SCALE) -> Operations:
        """One operation, refined; the same one is asked for again at every tolerance."""
        key = (*operation.key, steps, scale)
        if key not in self._known:
            context = self._context
            self._known[key] = refine(context.surface, context.points(3), operation, steps, scale=scale)
        return self._known[key]

    def _note_round(self, direction: FloatArray, point: FloatArray) -> None:
        """Keep a line about which the shape is round at least roughly, once."""
        if all(abs(float(direction @ other)) < PARALLEL for other, _ in self.round_lines):
            self.round_lines.append((direction, point))

    def _suggested(self, tolerance: float) -> Iterator[tuple[Hypothesis, tuple[object, ...] | None]]:
        """Larger groups that the one so far may be a part of, the likeliest first, with the keys they are known by."""
        group = self._group
        name, order = group.name, group.group.principal_order
        for larger, frame in supergroups(name, order, group.frame):
            key = (larger, name, order, *np.round(frame, 2).ravel().tolist())
            if self._was_tried(key, tolerance):
                continue
            centre = group.centre
            if larger == "Ci":
                context = self._context
                inversion = Operations(np.eye(3)[:1], centre[None], np.array([np.pi]), np.ones(1, dtype=np.bool_))
                if context.scores(inversion, self._implausible)[0] > self._implausible:
                    self._needs(key, np.inf, tolerance)
                    continue
                centre = self._refined(inversion, 12).points[0]
            yield Hypothesis(point_group(larger), frame, centre), key
        if order > 1 and name[0] in "CS" and not name.endswith("v"):
            key = ("azimuths", name)
            if not self._was_tried(key, tolerance):
                yield from ((hypothesis, None) for hypothesis in azimuths(self._context, group))
