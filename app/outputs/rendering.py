"""A small renderer: opaque triangles and translucent discs that cut through them, seen in parallel, without a display.

Triangles go through a depth buffer; rays meet discs exactly, pixel by pixel, and discs are blended by depth.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from app.outputs.raster import draw_triangles, lay_discs
from model.types import FloatArray

SUPERSAMPLING = 3
LIGHT = np.array([0.35, 0.6, 0.72])


def camera(azimuth: float, elevation: float) -> FloatArray:
    """Rows: to the right, up, towards the viewer, for angles in degrees; z is up in the world."""
    a, e = np.deg2rad(azimuth), np.deg2rad(elevation)
    towards = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return np.stack([right, np.cross(towards, right), towards])


@dataclass(slots=True, eq=False)
class Scene:
    """What is in a picture: ``view`` (3, 3) as `camera` gives it, ``centre`` (3,), half of the height ``half``."""

    view: FloatArray
    centre: FloatArray
    half: float
    _triangles: list[FloatArray] = field(default_factory=list[Any])
    _colours: list[FloatArray] = field(default_factory=list[Any])
    _discs: list[FloatArray] = field(default_factory=list[Any])

    def add_triangles(self, corners: FloatArray, colour: FloatArray, shade: float = 0.55) -> None:
        """Add opaque triangles (t, 3 corners, 3) of one colour; ``shade`` is how much the light does."""
        seen = (corners - self.centre) @ self.view.T
        normals = np.cross(seen[:, 1] - seen[:, 0], seen[:, 2] - seen[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        light = 1.0 - shade + shade * np.abs(normals @ (LIGHT / np.linalg.norm(LIGHT)))
        self._triangles.append(seen)
        self._colours.append(light[:, None] * colour)

    def add_tube(self, line: FloatArray, thickness: float, colour: FloatArray) -> None:
        """Add a thin tube along a line of points (n, 3)."""
        along = np.empty_like(line)
        along[1:-1], along[0], along[-1] = line[2:] - line[:-2], line[1] - line[0], line[-1] - line[-2]
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        side = np.cross(along, np.eye(3)[np.argmin(np.abs(along).sum(0))])
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        other = np.cross(along, side)
        angles = np.linspace(0.0, 2.0 * np.pi, 7)[:, None, None]
        rings = line + thickness * (np.cos(angles) * side + np.sin(angles) * other)
        a, b, c, d = rings[:-1, :-1], rings[1:, :-1], rings[1:, 1:], rings[:-1, 1:]
        quads = np.stack([a, b, c, a, c, d], axis=2).reshape(-1, 3, 3)
        self.add_triangles(quads, colour, shade=0.3)

    def add_disc(self, centre: FloatArray, normal: FloatArray, radius: float, colour: FloatArray, alpha: float) -> None:
        """Add a translucent disc with a thin rim."""
        seen = (centre - self.centre) @ self.view.T
        self._discs.append(np.concatenate([seen, self.view @ normal, [radius], colour, [alpha]]))
        least = np.eye(3)[int(np.argmin(np.abs(normal)))]
        across = least - (least @ normal) * normal
        first: FloatArray = across / float(np.linalg.norm(across))
        angles = np.linspace(0.0, 2.0 * np.pi, 97)[:, None]
        second: FloatArray = np.cross(normal, first)
        rim: FloatArray = centre + radius * (np.cos(angles) * first + np.sin(angles) * second)
        self.add_tube(rim, 0.006 * self.half, colour)

    def image(self, pixels: int) -> FloatArray:
        """The picture on white, (pixels, pixels, 3) in 0 .. 1."""
        count = pixels * SUPERSAMPLING
        depth = np.full((count, count), -np.inf)
        colour = np.ones((count, count, 3))
        # From the viewer's frame to pixels, of which the middles are whole numbers; the depth stays.
        scale = count / (2.0 * self.half)
        corners = np.concatenate(self._triangles)
        corners = np.concatenate([corners[..., :2] * scale + count / 2.0 - 0.5, corners[..., 2:]], axis=2)
        draw_triangles(corners, np.concatenate(self._colours), depth, colour)
        if self._discs:
            ticks = ((np.arange(count) + 0.5) / count * 2.0 - 1.0) * self.half
            discs = np.array(self._discs)
            lay_discs(discs, ticks, depth, colour, np.empty(len(discs)), np.empty(len(discs), dtype=np.int64))
        small = colour.reshape(pixels, SUPERSAMPLING, pixels, SUPERSAMPLING, 3).mean((1, 3))
        return np.clip(small[::-1], 0.0, 1.0)
