"""A shape with planes and axes as a picture: its surface is drawn as points with a depth for every pixel."""

from collections.abc import Sequence

import numpy as np

from model.geometry.sampling import sample_surface
from model.types import BoolArray, FloatArray, IntArray

SIZE = 150
"""Pixels of a picture's side."""

_REACH = 0.54
"""Unit frame: half of what a picture's side shows."""

_POINTS = 60_000
_PER_SIDE = 260
_SQUARE = 0.42
"""Half the side of the square that stands for a plane, unit frame."""

_VEIL, _RIM = 0.22, 0.85
"""How opaque a plane is, and its rim."""

_HIDDEN = 0.35
"""How much of an axis is seen through the surface."""

_ELEVATION, _AZIMUTH = np.deg2rad(22.0), np.deg2rad(-58.0)


def camera() -> FloatArray:
    """Rows ``(3, 3)``: to the right, up, and towards the viewer."""
    towards = np.array(
        [np.cos(_ELEVATION) * np.cos(_AZIMUTH), np.cos(_ELEVATION) * np.sin(_AZIMUTH), np.sin(_ELEVATION)]
    )
    right = np.cross([0.0, 0.0, 1.0], towards)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(towards, right), towards])


def sampled(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, FloatArray]:
    """Points ``(n, 3)`` of the surface ``vertices`` ``(v, 3)``, ``faces`` ``(f, 3)``, and unit normals, to be drawn."""
    points, of_face = sample_surface(vertices, faces, _POINTS, seed=0)
    a, b, c = (vertices[faces[of_face, corner]] for corner in range(3))
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return points, normals / np.where(length > 0.0, length, 1.0)


class SolidView:
    """A surface in the unit frame, seen from the camera; planes and axes are laid over it."""

    def __init__(self, points: FloatArray, normals: FloatArray) -> None:
        """Draw a surface of ``points`` ``(n, 3)`` with unit ``normals`` ``(n, 3)`` of either sign, see `sampled`."""
        self.points = points
        facing = np.abs(normals @ camera()[2])
        self._shade = 0.45 + 0.55 * facing
        self._depth = np.full((SIZE, SIZE), -np.inf)
        self._source = np.full((SIZE, SIZE), -1)
        row, column, depth = _projected(self.points)
        # A sample covers four pixels, so that no gap is seen between neighbours; the nearest comes last.
        order = np.argsort(depth)
        for down in (0, 1):
            for right in (0, 1):
                y, x = row[order] + down, column[order] + right
                inside = (y >= 0) & (y < SIZE) & (x >= 0) & (x < SIZE)
                nearest = np.full((SIZE, SIZE), -1)
                nearest[y[inside], x[inside]] = order[inside]
                nearer = (nearest >= 0) & (np.where(nearest >= 0, depth[nearest], -np.inf) > self._depth)
                self._source[nearer] = nearest[nearer]
                self._depth[nearer] = depth[nearest[nearer]]

    def draw(
        self,
        colours: FloatArray,
        planes: Sequence[tuple[FloatArray, FloatArray]] = (),
        axes: Sequence[tuple[FloatArray, FloatArray, FloatArray]] = (),
    ) -> FloatArray:
        """The picture ``(SIZE, SIZE, 3)``, red, green and blue from 0 to 1.

        Args:
            colours: of the surface, ``(3,)`` or one for each of `points`, ``(n, 3)``.
            planes: rows (n, d) ``(4,)`` with a colour ``(3,)`` each.
            axes: direction ``(3,)``, point ``(3,)`` and colour ``(3,)`` of each.
        """
        picture = np.ones((SIZE, SIZE, 3))
        surface = self._source >= 0
        shaded = np.broadcast_to(colours, (len(self.points), 3)) * self._shade[:, None]
        picture[surface] = shaded[self._source[surface]]
        for plane, colour in planes:
            self._lay_plane(picture, plane, colour)
        for direction, point, colour in axes:
            self._lay_axis(picture, direction, point, colour)
        return picture

    def _lay_plane(self, picture: FloatArray, plane: FloatArray, colour: FloatArray) -> None:
        normal = plane[:3] / np.linalg.norm(plane[:3])
        first, second = np.linalg.svd(normal[None])[2][1:]
        side = np.linspace(-_SQUARE, _SQUARE, _PER_SIDE)
        u, v = (grid.ravel() for grid in np.meshgrid(side, side))
        points = -plane[3] / np.linalg.norm(plane[:3]) * normal + u[:, None] * first + v[:, None] * second
        rim = np.maximum(np.abs(u), np.abs(v)) > _SQUARE - 0.008
        for part, opaque in ((np.ones_like(rim), _VEIL), (rim, _RIM)):
            seen = self._cover(points[part], in_front=True)
            picture[seen] = (1.0 - opaque) * picture[seen] + opaque * colour

    def _lay_axis(self, picture: FloatArray, direction: FloatArray, point: FloatArray, colour: FloatArray) -> None:
        direction = direction / np.linalg.norm(direction)
        middle = point - (point @ direction) * direction
        along = np.linspace(-0.54, 0.54, 500)[:, None] * direction
        right, up = camera()[:2]
        pixel = 2.0 * _REACH / SIZE
        line = np.concatenate([middle + along + pixel * (a * right + b * up) for a in (-1, 0, 1) for b in (-1, 0, 1)])
        hidden, seen = self._cover(line, in_front=False), self._cover(line, in_front=True)
        for covered, opaque in ((hidden & ~seen, _HIDDEN), (seen, 1.0)):
            picture[covered] = (1.0 - opaque) * picture[covered] + opaque * colour

    def _cover(self, points: FloatArray, *, in_front: bool) -> BoolArray:
        """Pixels ``(SIZE, SIZE)`` that points ``(n, 3)`` cover; only those before the surface where asked."""
        row, column, depth = _projected(points)
        inside = (row >= 0) & (row < SIZE) & (column >= 0) & (column < SIZE)
        row, column, depth = row[inside], column[inside], depth[inside]
        if in_front:
            nearer = depth > self._depth[row, column]
            row, column = row[nearer], column[nearer]
        covered = np.zeros((SIZE, SIZE), dtype=bool)
        covered[row, column] = True
        return covered


def _projected(points: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Row and column of the pixel of each point ``(n, 3)``, and how near it is to the viewer."""
    right, up, depth = (points @ camera().T).T
    column = np.floor((right + _REACH) / (2.0 * _REACH) * SIZE).astype(np.int64)
    row = np.floor((_REACH - up) / (2.0 * _REACH) * SIZE).astype(np.int64)
    return row, column, depth
