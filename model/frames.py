"""The frames of the design: input, unit and inertia, and how planes and axes move between them."""

from dataclasses import dataclass

import numpy as np

from model.errors import DegenerateMeshError
from model.types import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class UnitFrame:
    """The unit frame: ``unit = (input - center) / scale``.

    ``center`` is the area-weighted surface centroid ``(3,)``, ``scale`` twice the largest distance of a surface
    point from it, both in input units. The shape then lies in a ball of diameter 1, in every orientation inside the
    unit cube, and every exact symmetry plane and axis passes through the origin.
    """

    center: FloatArray
    scale: float

    @classmethod
    def of(cls, vertices: FloatArray, faces: IntArray) -> "UnitFrame":
        """The unit frame of a surface, ``(v, 3)`` float64 and ``(f, 3)`` int32.

        Raises:
            DegenerateMeshError: the surface has no area.
        """
        # Shift and scale first: squares of a mesh far from the origin, or in nanometres, would lose digits.
        corners = vertices[faces]
        low, high = corners.min((0, 1)), corners.max((0, 1))
        extent = float((high - low).max())
        if not extent > 0.0:
            raise DegenerateMeshError("The mesh has no extent: all its points coincide.")
        middle = (low + high) / 2.0
        corners = (corners - middle) / extent
        areas = triangle_areas(corners)
        total = float(areas.sum())
        if not total > 0.0:
            raise DegenerateMeshError("The surface has no area: every face is a line or a point.")
        centroid = areas @ corners.mean(1) / total
        radius = float(np.sqrt(np.square(corners - centroid).sum(-1).max()))
        return cls(middle + extent * centroid, 2.0 * radius * extent)

    def to_unit(self, points: FloatArray) -> FloatArray:
        """Points ``(..., 3)`` of the input frame in the unit frame."""
        return np.ascontiguousarray((points - self.center) / self.scale)

    def to_input(self, points: FloatArray) -> FloatArray:
        """Points ``(..., 3)`` of the unit frame in the input frame."""
        return points * self.scale + self.center

    def plane_to_input(self, plane: FloatArray) -> FloatArray:
        """A plane ``(n, d)`` ``(4,)`` of the unit frame in the input frame."""
        normal = plane[:3]
        return np.append(normal, plane[3] * self.scale - normal @ self.center)


def triangle_areas(corners: FloatArray) -> FloatArray:
    """Areas of triangles ``(f, 3 corners, 3)``: ``(f,)``."""
    # Component by component: several times faster than numpy's cross product of many short vectors.
    px, py, pz = (corners[:, 1] - corners[:, 0]).T
    qx, qy, qz = (corners[:, 2] - corners[:, 0]).T
    x, y, z = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
    return 0.5 * np.sqrt(x * x + y * y + z * z)


def inertia_frame(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, FloatArray]:
    """Eigenvectors of the surface's covariance about the origin (the area centroid, in the unit frame).

    The covariance is the exact integral over the triangles. Where eigenvalues tie the eigenvectors are arbitrary
    within their span; the caller sees that from the eigenvalues.

    Args:
        vertices: ``(v, 3)`` float64, unit frame.
        faces: ``(f, 3)`` int32.

    Returns:
        rotation: ``(3, 3)`` proper rotation whose rows are the eigenvectors, largest eigenvalue first;
            ``rotation @ x`` takes a unit-frame point to the inertia frame.
        eigenvalues: ``(3,)`` descending.
    """
    corners = vertices[faces]
    areas = triangle_areas(corners)
    middle = corners.mean(1)
    weights = areas / (12.0 * areas.sum())
    points = corners.reshape(-1, 3)
    moments = (np.repeat(weights, 3)[:, None] * points).T @ points
    moments += 9.0 * (weights[:, None] * middle).T @ middle
    values, vectors = np.linalg.eigh(moments)
    rotation = np.ascontiguousarray(vectors.T[::-1])
    if np.linalg.det(rotation) < 0:
        rotation[2] *= -1.0
    return rotation, np.ascontiguousarray(values[::-1])
