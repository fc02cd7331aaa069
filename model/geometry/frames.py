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
        # Coordinates in rows: reductions along contiguous memory are many times faster.
        used = np.ascontiguousarray(vertices[faces.ravel()].T)
        low, high = used.min(1), used.max(1)
        extent = float((high - low).max())
        if not extent > 0.0:
            raise DegenerateMeshError("The mesh has no extent: all its points coincide.")
        middle = (low + high) / 2.0
        used = (used - middle[:, None]) / extent
        corners = used.reshape(3, -1, 3)
        areas = _areas(corners)
        total = float(areas.sum())
        if not total > 0.0:
            raise DegenerateMeshError("The surface has no area: every face is a line or a point.")
        centroid = (corners[:, :, 0] + corners[:, :, 1] + corners[:, :, 2]) @ areas / (3.0 * total)
        x, y, z = used - centroid[:, None]
        radius = float(np.sqrt((x * x + y * y + z * z).max()))
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

    def plane_to_unit(self, plane: FloatArray) -> FloatArray:
        """A plane ``(n, d)`` ``(4,)`` of the input frame in the unit frame."""
        normal = plane[:3]
        return np.append(normal, (plane[3] + normal @ self.center) / self.scale)


def triangle_areas(corners: FloatArray) -> FloatArray:
    """Areas of triangles ``(f, 3 corners, 3)``: ``(f,)``."""
    return _areas(np.moveaxis(corners, 2, 0))


def _areas(corners: FloatArray) -> FloatArray:
    """Areas of triangles ``(3 coordinates, f, 3 corners)``; faster than the cross product of numpy."""
    px, py, pz = corners[:, :, 1] - corners[:, :, 0]
    qx, qy, qz = corners[:, :, 2] - corners[:, :, 0]
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
    corners = np.ascontiguousarray(vertices[faces.ravel()].T).reshape(3, -1, 3)
    areas = _areas(corners)
    weights = areas / (12.0 * areas.sum())
    total = corners[:, :, 0] + corners[:, :, 1] + corners[:, :, 2]
    points = corners.reshape(3, -1)
    moments = (points * np.repeat(weights, 3)) @ points.T + (total * weights) @ total.T
    values, vectors = np.linalg.eigh(moments)
    rotation = np.ascontiguousarray(vectors.T[::-1])
    if np.linalg.det(rotation) < 0:
        rotation[2] *= -1.0
    return rotation, np.ascontiguousarray(values[::-1])
