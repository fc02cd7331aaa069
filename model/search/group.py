"""The symmetry group that a few operations generate, about their common centre, in the unit frame."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from model.geometry.operations import Operations
from model.search import closure
from model.search.candidates import distinct
from model.types import BoolArray, FloatArray

_OFF_CENTRE = 0.02
"""Elements of one group meet in a point; one that passes it by more (unit frame) belongs to none."""


@dataclass(frozen=True, eq=False)
class Group:
    """A finite group: ``generators``, the most reliable first, all ``matrices`` ``(g, 3, 3)``, ``centre`` ``(3,)``."""

    generators: Operations
    errors: FloatArray
    matrices: FloatArray
    centre: FloatArray

    @classmethod
    def generated(
        cls,
        operations: Operations,
        errors: FloatArray,
        centre: FloatArray,
        largest: int = closure.LARGEST,
        holds: "Callable[[Operations, float], bool] | None" = None,
    ) -> "Group":
        """The group of the operations that fit together, taken by rising error.

        Operations that the group already holds are left out, as are those that do not meet the others in one point, or
        with which products would never close.

        Args:
            operations: candidates.
            errors: their SDE ``(k,)``.
            centre: where the group's centre is assumed along directions that no element fixes, ``(3,)``.
            largest: groups with axes of higher order are not built.
            holds: tells whether the shape has the elements that an operation would bring in besides itself, given the
                largest error of the generators.
        """
        matrices = np.eye(3)[None]
        chosen: list[int] = []
        linear = operations.matrices
        for index in np.argsort(errors, kind="stable").tolist():
            if closure.contains(matrices, linear[index : index + 1])[0]:
                continue
            trial = operations[[*chosen, index]]
            middle = common_point(trial, centre)
            if distances_from(trial, middle).max() > _OFF_CENTRE:
                continue
            grown = closure.closure(trial.matrices, largest)
            if grown is None:
                continue
            if (
                holds is not None
                and len(grown) > 2
                and not holds(_element_operations(grown, middle, matrices), float(errors[[*chosen, index]].max()))
            ):
                continue
            matrices = grown
            chosen.append(index)
        generators = operations[chosen]
        return cls(generators, errors[chosen], matrices, common_point(generators, centre))

    def with_operations(
        self, operations: Operations, errors: FloatArray, largest: int, holds: Callable[[Operations, float], bool]
    ) -> "Group":
        """The group with more generators; the arguments are those of `generated`."""
        joined = Operations.joined([self.generators, operations])
        return Group.generated(joined, np.concatenate([self.errors, errors]), self.centre, largest, holds)

    def without_worst(self) -> "Group":
        """The group of all generators but the one with the largest error."""
        kept = np.argsort(self.errors, kind="stable")[:-1].tolist()
        return Group.generated(self.generators[kept], self.errors[kept], self.centre)

    def holds(self, operations: Operations) -> BoolArray:
        """Which operations are members, position set aside: ``(k,)``."""
        return closure.contains(self.matrices, operations.matrices)

    def images(self, operation: Operations) -> Operations:
        """One operation (a batch of one) seen from every member of the group: its conjugates, each once."""
        directions = self.matrices @ operation.directions[0]
        points = (operation.points[0] - self.centre) @ self.matrices.transpose(0, 2, 1) + self.centre
        count = len(self.matrices)
        angles = np.full(count, operation.angles[0])
        moved = Operations(directions, points, angles, np.full(count, operation.improper[0]))
        return moved[distinct(moved, np.zeros(count))]

    @property
    def element_operations(self) -> Operations:
        """Reflections in all planes, then the smallest turns about all axes."""
        return _element_operations(self.matrices, self.centre, np.zeros((0, 3, 3)))

    @cached_property
    def elements(self) -> closure.Elements:
        """Planes and axes."""
        return closure.elements(self.matrices)

    @property
    def name(self) -> str:
        """The Schoenflies symbol."""
        return closure.name(self.matrices)


def _element_operations(matrices: FloatArray, centre: FloatArray, known: FloatArray) -> Operations:
    """Reflections and smallest turns of a group about a centre, without those of the ``known`` matrices."""
    normals, directions, orders = closure.elements(matrices)
    planes = Operations.reflections(np.column_stack([normals, -normals @ centre]))
    turns = 2.0 * np.pi / np.array(orders, dtype=np.float64)
    operations = Operations.joined([planes, Operations.rotations(directions, centre, turns)])
    return operations[np.flatnonzero(~closure.contains(known, operations.matrices))] if len(known) else operations


def common_point(operations: Operations, near: FloatArray) -> FloatArray:
    """The point that all operations leave in place, by least squares; where they leave it open, the one ``near``."""
    if not len(operations):
        return near
    fixed = np.eye(3) - operations.matrices
    shifts = np.einsum("kij,kj->ki", fixed, operations.points - near)
    rows = fixed.reshape(-1, 3)
    # The pseudo-inverse without its smallest parts: along an axis, or within a plane, nothing holds the point.
    return near + np.linalg.pinv(rows, rcond=0.02) @ shifts.ravel()


def distances_from(operations: Operations, point: FloatArray) -> FloatArray:
    """How far each element passes by a point: half the way the operation moves it, ``(k,)``."""
    moved = operations.apply(point[None])[:, 0] - point
    return 0.5 * np.sqrt(np.square(moved).sum(1))
