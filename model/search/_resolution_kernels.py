"""One look at all coordinates: see `model.search.exactness.resolution_of`."""

import numpy as np

from model._jit import jit
from model.types import FloatArray


@jit
def extent_and_precision(vertices: FloatArray) -> tuple[float, float, bool]:
    """The largest magnitude, the largest extent, and whether all coordinates are numbers of single precision."""
    largest, extent, single = 0.0, 0.0, True
    for axis in range(3):
        low, high = np.inf, -np.inf
        for vertex in range(vertices.shape[0]):
            value = vertices[vertex, axis]
            low, high = min(low, value), max(high, value)
            single &= float(np.float32(value)) == value
        largest, extent = max(largest, abs(low), abs(high)), max(extent, high - low)
    return largest, extent, single
