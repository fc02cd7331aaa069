"""The inner loops of ``rendering``: triangles into a depth buffer, discs over it."""

import numpy as np

from model._jit import jit
from model.types import AnyArray, FloatArray


@jit
def draw_triangles(corners: FloatArray, tints: FloatArray, depth: FloatArray, colour: FloatArray) -> None:
    """Triangles ``(t, 3 corners, 3)``, x and y in pixels, into ``depth`` ``(n, n)`` and ``colour`` ``(n, n, 3)``."""
    count = depth.shape[0]
    for t in range(corners.shape[0]):
        ax, ay, az = corners[t, 0, 0], corners[t, 0, 1], corners[t, 0, 2]
        bx, by, bz = corners[t, 1, 0], corners[t, 1, 1], corners[t, 1, 2]
        cx, cy, cz = corners[t, 2, 0], corners[t, 2, 1], corners[t, 2, 2]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if not abs(area) > 0.0:  # seen from the side
            continue
        left, right = max(np.ceil(min(ax, bx, cx)), 0.0), min(np.floor(max(ax, bx, cx)), count - 1.0)
        bottom, top = max(np.ceil(min(ay, by, cy)), 0.0), min(np.floor(max(ay, by, cy)), count - 1.0)
        for y in range(int(bottom), int(top) + 1):
            for x in range(int(left), int(right) + 1):
                v = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
                w = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
                if v >= 0.0 and w >= 0.0 and v + w <= 1.0:
                    z = az + v * (bz - az) + w * (cz - az)
                    if z > depth[y, x]:
                        depth[y, x] = z
                        for channel in range(3):
                            colour[y, x, channel] = tints[t, channel]


@jit
def lay_discs(
    discs: FloatArray, ticks: FloatArray, depth: FloatArray, colour: FloatArray, heights: FloatArray, order: AnyArray
) -> None:
    """Translucent discs over a picture, far ones first, pixel by pixel.

    ``discs`` ``(d, 11)``: centre, normal, radius, colour, alpha; ``ticks`` ``(n,)``: where the pixels are; ``heights``
    and ``order`` ``(d,)`` are room to work in.
    """
    for i in range(depth.shape[0]):
        for j in range(depth.shape[1]):
            met = 0
            for k in range(discs.shape[0]):
                x, y = ticks[j] - discs[k, 0], ticks[i] - discs[k, 1]
                if abs(discs[k, 5]) < 1e-6:  # seen from the side: its rim is all there is
                    continue
                z = -(discs[k, 3] * x + discs[k, 4] * y) / discs[k, 5]
                if x * x + y * y + z * z > discs[k, 6] * discs[k, 6] or z + discs[k, 2] < depth[i, j]:
                    continue
                at = met
                while at > 0 and heights[at - 1] > z + discs[k, 2]:
                    heights[at], order[at] = heights[at - 1], order[at - 1]
                    at -= 1
                heights[at], order[at] = z + discs[k, 2], k
                met += 1
            for at in range(met):
                alpha = discs[order[at], 10]
                for channel in range(3):
                    tint = discs[order[at], 7 + channel]
                    colour[i, j, channel] = (1.0 - alpha) * colour[i, j, channel] + alpha * tint
