"""Symmetry operations in batches, one representation for reflections, rotations, inversions and rotoreflections."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from model._jit import kernel_array
from model.geometry import _operation_kernels as kernels
from model.types import AnyArray, BoolArray, FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Operations:
    """k isometries with a fixed point: turn by ``angles`` about a line and, where ``improper``, reflect across it.

    ``directions`` ``(k, 3)`` unit, ``points`` ``(k, 3)`` on the element (a plane, an axis, a centre), ``angles``
    ``(k,)`` radians, ``improper`` ``(k,)``. A reflection is improper with angle 0 and the plane's normal as direction;
    the inversion is improper with angle pi. Any one frame; lengths in its unit.
    """

    directions: FloatArray
    points: FloatArray
    angles: FloatArray
    improper: BoolArray

    @classmethod
    def reflections(cls, planes: FloatArray) -> "Operations":
        """Reflections in planes ``(k, 4)``, rows ``(n, d)`` with unit normals."""
        planes = np.asarray(planes, dtype=np.float64).reshape(-1, 4)
        count = len(planes)
        return cls(planes[:, :3], -planes[:, 3:] * planes[:, :3], np.zeros(count), np.ones(count, dtype=np.bool_))

    @classmethod
    def rotations(cls, directions: FloatArray, points: FloatArray, angles: FloatArray | float) -> "Operations":
        """Rotations about axes: unit ``directions`` and ``points`` ``(k, 3)``, ``angles`` ``(k,)`` radians.

        One direction ``(3,)``, one point or one angle serves all.
        """
        rows = np.asarray(directions, dtype=np.float64).reshape(-1, 3)
        turns: FloatArray = np.asarray(angles, dtype=np.float64)
        count = len(turns) if turns.ndim and len(rows) == 1 else len(rows)
        lines, places, about = np.empty((count, 3)), np.empty((count, 3)), np.empty(count)
        lines[:], places[:], about[:] = rows, points, turns
        return cls(lines, places, about, np.zeros(count, dtype=np.bool_))

    @classmethod
    def joined(cls, parts: "Sequence[Operations]") -> "Operations":
        """All operations of several batches, in order."""
        return cls(
            np.concatenate([part.directions for part in parts]).reshape(-1, 3),
            np.concatenate([part.points for part in parts]).reshape(-1, 3),
            np.concatenate([part.angles for part in parts]),
            np.concatenate([part.improper for part in parts]),
        )

    def __len__(self) -> int:
        return len(self.angles)

    def __getitem__(self, index: "slice | Sequence[int] | AnyArray") -> "Operations":
        return Operations(self.directions[index], self.points[index], self.angles[index], self.improper[index])

    @property
    def key(self) -> tuple[bytes, ...]:
        """Equal for equal operations: to know by what was found about them before."""
        parts = (self.directions, self.points, self.angles, self.improper)
        return tuple(part.tobytes() for part in parts)

    @property
    def matrices(self) -> FloatArray:
        """The linear parts ``(k, 3, 3)``, orthogonal."""
        return linear_parts(self.directions, self.angles, self.improper)

    @property
    def planes(self) -> FloatArray:
        """Plane through the point across the direction, ``(k, 4)`` rows ``(n, d)``; what a reflection mirrors in."""
        offsets = -np.einsum("ki,ki->k", self.directions, self.points)
        return np.column_stack([self.directions, offsets])

    def apply(self, points: FloatArray) -> FloatArray:
        """Images of points ``(n, 3)`` under every operation: ``(k, n, 3)``."""
        points = kernel_array(points, np.float64)
        result = np.empty((len(self), len(points), 3))
        kernels.images(points, kernel_array(self.points, np.float64), self.matrices, result)
        return result

    def moved(self, turns: FloatArray, shifts: FloatArray) -> "Operations":
        """The operations after their elements are turned about the origin and shifted: conjugates, of the same kind.

        Args:
            turns: ``(k, 3)`` rotation vectors, radians.
            shifts: ``(k, 3)``.
        """
        length = np.sqrt(np.square(turns).sum(1))
        units = turns / np.where(length > 0.0, length, 1.0)[:, None]
        matrices = linear_parts(units, length, np.zeros(len(length), dtype=np.bool_))
        directions = (matrices @ self.directions[..., None])[..., 0]
        directions /= np.sqrt(np.square(directions).sum(1))[:, None]
        points = (matrices @ self.points[..., None])[..., 0] + shifts
        return Operations(directions, points, self.angles, self.improper)


def linear_parts(directions: FloatArray, angles: FloatArray, improper: BoolArray) -> FloatArray:
    """``(k, 3, 3)``: rotations about unit ``directions`` (Rodrigues), followed by the reflection across where improper.

    Both in one formula: the component along the direction is multiplied by 1 or -1, the rest turned.
    """
    result = np.empty((len(angles), 3, 3))
    along = np.where(improper, -1.0, 1.0)
    directions, angles = kernel_array(directions, np.float64), kernel_array(angles, np.float64)
    kernels.linear_parts(directions, angles, along, result)
    return result
