"""A small renderer for the pictures: opaque triangles and translucent discs that cut through them, seen in parallel.

Triangles go through a depth buffer; discs are met exactly, pixel by pixel, and laid over each other by depth.
"""

from dataclasses import dataclass, field

import numpy as np

SUPERSAMPLING = 3
LIGHT = np.array([0.35, 0.6, 0.72])


def camera(azimuth: float, elevation: float) -> np.ndarray:
    """Rows: to the right, up, towards the viewer, for angles in degrees; z is up in the world."""
    a, e = np.deg2rad(azimuth), np.deg2rad(elevation)
    towards = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return np.stack([right, np.cross(towards, right), towards])


@dataclass
class Scene:
    """What is in a picture: ``view`` (3, 3) as `camera` gives it, ``centre`` (3,), half of the height ``half``."""

    view: np.ndarray
    centre: np.ndarray
    half: float
    triangles: list[np.ndarray] = field(default_factory=list)
    colours: list[np.ndarray] = field(default_factory=list)
    discs: list[tuple[np.ndarray, np.ndarray, float, np.ndarray, float]] = field(default_factory=list)

    def add_triangles(self, corners: np.ndarray, colour: np.ndarray, shade: float = 0.55) -> None:
        """Add opaque triangles (t, 3 corners, 3) of one colour; ``shade`` is how much the light does."""
        seen = (corners - self.centre) @ self.view.T
        normals = np.cross(seen[:, 1] - seen[:, 0], seen[:, 2] - seen[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        light = 1.0 - shade + shade * np.abs(normals @ (LIGHT / np.linalg.norm(LIGHT)))
        self.triangles.append(seen)
        self.colours.append(light[:, None] * colour)

    def add_tube(self, line: np.ndarray, thickness: float, colour: np.ndarray) -> None:
        """Add a thin tube along a line of points (n, 3)."""
        along = np.gradient(line, axis=0)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        side = np.cross(along, np.eye(3)[np.argmin(np.abs(along).sum(0))])
        side /= np.linalg.norm(side, axis=1, keepdims=True)
        other = np.cross(along, side)
        angles = np.linspace(0.0, 2.0 * np.pi, 7)[:, None, None]
        rings = line + thickness * (np.cos(angles) * side + np.sin(angles) * other)
        a, b, c, d = rings[:-1, :-1], rings[1:, :-1], rings[1:, 1:], rings[:-1, 1:]
        quads = np.stack([a, b, c, a, c, d], axis=2).reshape(-1, 3, 3)
        self.add_triangles(quads, colour, shade=0.3)

    def add_disc(self, centre: np.ndarray, normal: np.ndarray, radius: float, colour: np.ndarray, alpha: float) -> None:
        """Add a translucent disc with a thin rim."""
        self.discs.append(((centre - self.centre) @ self.view.T, self.view @ normal, radius, colour, alpha))
        first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        first /= np.linalg.norm(first)
        angles = np.linspace(0.0, 2.0 * np.pi, 97)[:, None]
        rim = centre + radius * (np.cos(angles) * first + np.sin(angles) * np.cross(normal, first))
        self.add_tube(rim, 0.006 * self.half, colour)

    def image(self, pixels: int) -> np.ndarray:
        """The picture on white, (pixels, pixels, 3) in 0 .. 1."""
        count = pixels * SUPERSAMPLING
        depth = np.full((count, count), -np.inf)
        colour = np.ones((count, count, 3))
        ticks = (np.arange(count) + 0.5) / count * 2.0 - 1.0
        for corners, tint in zip(np.concatenate(self.triangles), np.concatenate(self.colours), strict=True):
            _fill(corners, tint, ticks * self.half, depth, colour)
        x, y = np.meshgrid(ticks * self.half, ticks * self.half)
        layers: list[np.ndarray] = []
        for centre, normal, radius, _, _ in self.discs:
            if abs(normal[2]) < 1e-6:  # seen from the side: the rim is all there is
                layers.append(np.full(x.shape, -np.inf))
                continue
            z = centre[2] - (normal[0] * (x - centre[0]) + normal[1] * (y - centre[1])) / normal[2]
            outside = (x - centre[0]) ** 2 + (y - centre[1]) ** 2 + (z - centre[2]) ** 2 > radius**2
            layers.append(np.where(outside | (z < depth), -np.inf, z))
        if layers:
            stack = np.stack(layers)
            tints = np.stack([tint for _, _, _, tint, _ in self.discs])
            alphas = np.array([alpha for *_, alpha in self.discs])
            for order in np.argsort(stack, axis=0):  # far ones first
                there = np.isfinite(np.take_along_axis(stack, order[None], axis=0)[0])
                alpha = np.where(there, alphas[order], 0.0)[..., None]
                colour = (1.0 - alpha) * colour + alpha * tints[order]
        small = colour.reshape(pixels, SUPERSAMPLING, pixels, SUPERSAMPLING, 3).mean((1, 3))
        return np.clip(small[::-1], 0.0, 1.0)


def _fill(corners: np.ndarray, tint: np.ndarray, ticks: np.ndarray, depth: np.ndarray, colour: np.ndarray) -> None:
    """Draw one triangle into the depth buffer."""
    low, high = corners[:, :2].min(0), corners[:, :2].max(0)
    (left, bottom), (right, top) = np.searchsorted(ticks, low), np.searchsorted(ticks, high)
    if left == right or bottom == top:
        return
    a, b, c = corners
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    if area == 0.0:
        return
    x, y = ticks[None, left:right], ticks[bottom:top, None]
    v = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area
    w = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area
    z = a[2] + v * (b[2] - a[2]) + w * (c[2] - a[2])
    view = depth[bottom:top, left:right]
    seen = (v >= 0.0) & (w >= 0.0) & (v + w <= 1.0) & (z > view)
    view[seen] = z[seen]
    colour[bottom:top, left:right][seen] = tint
