"""The comparison behind `model.search.candidates.distinct`."""

import numpy as np

from model._jit import jit
from model.types import AnyArray, BoolArray, FloatArray


@jit
def keep_distinct(
    directions: FloatArray,
    points: FloatArray,
    angles: FloatArray,
    improper: BoolArray,
    errors: FloatArray,
    order: AnyArray,
    same_angle: float,
    same_distance: float,
    cosine: float,
    basin: float,
    much_better: float,
    kept: AnyArray,
) -> int:
    """Fill ``kept`` with the indices, taken in ``order``, of operations that differ from all kept before: how many.

    Elements are the same within the angle of ``cosine``; beside one that is ``much_better`` within that of ``basin``.
    """
    count = 0
    for index in order:
        x, y, z = directions[index, 0], directions[index, 1], directions[index, 2]
        px, py, pz = points[index, 0], points[index, 1], points[index, 2]
        inversion = improper[index] and angles[index] > 3.0
        new = True
        for place in range(count):
            other = kept[place]
            if improper[other] != improper[index] or abs(angles[other] - angles[index]) > same_angle:
                continue
            ox, oy, oz = directions[other, 0], directions[other, 1], directions[other, 2]
            along = x * ox + y * oy + z * oz
            gx, gy, gz = px - points[other, 0], py - points[other, 1], pz - points[other, 2]
            length = gx * gx + gy * gy + gz * gz
            if inversion:  # it has no direction
                along, apart = 1.0, np.sqrt(length)
            elif improper[index]:  # planes are compared by their offset
                offset = ox * points[other, 0] + oy * points[other, 1] + oz * points[other, 2]
                apart = abs(x * px + y * py + z * pz - (offset if along > 0.0 else -offset))
            else:  # axes by their distance
                beside = gx * x + gy * y + gz * z
                apart = np.sqrt(max(length - beside * beside, 0.0))
            nearest = basin if errors[index] > much_better * errors[other] else cosine
            if apart < same_distance and abs(along) >= nearest:
                new = False
                break
        if new:
            kept[count] = index
            count += 1
    return count
