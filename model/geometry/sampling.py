"""Uniform points on a surface, for symmetry errors and for training."""

import numpy as np

from model._jit import jit_allocating, kernel_array
from model.errors import DegenerateMeshError
from model.types import FloatArray, IntArray

_LOOKED_AT = 20_000


def sample_surface(vertices: FloatArray, faces: IntArray, count: int, seed: int) -> tuple[FloatArray, IntArray]:
    """Points distributed uniformly over the surface, with low variance.

    The surface, laid out face after face by area, is cut into ``count`` strips of equal area and one point drawn in
    each. A face therefore receives its expected number of points, rounded up or down. The points come ordered by face:
    to take fewer, draw fewer, or take every k-th.

    Args:
        vertices: (v, 3) finite coordinates, any frame.
        faces: (f, 3) vertex indices; faces without area receive no points.
        count: number of points n.
        seed: the same seed gives the same points on every machine.

    Returns:
        (n, 3) float64 points in the frame of the vertices, and (n,) int32 indices of the faces they lie on.

    Raises:
        DegenerateMeshError: no face has an area.
    """
    points = np.empty((count, 3))
    owners = np.empty(count, dtype=np.int32)
    numbers = np.random.Generator(np.random.PCG64(seed)).random((count, 2))
    if not _draw(kernel_array(vertices, np.float64), kernel_array(faces, np.int32), numbers, points, owners):
        raise DegenerateMeshError("The mesh has no surface area.")
    return points, owners


def extreme_vertices(vertices: FloatArray, faces: IntArray, directions: FloatArray) -> FloatArray:
    """The vertices that reach farthest in ``directions`` ``(d, 3)``, each once: ``(k, 3)``.

    They are the corners and rims by which flat and angular shapes are told from their turned copies, and which hardly
    any sample of the surface hits. Of very large meshes only a part of the vertices is looked at.
    """
    is_used = np.zeros(len(vertices), dtype=np.bool_)
    is_used[faces.ravel()[:: max(1, faces.size // _LOOKED_AT)]] = True
    used = vertices[is_used]
    return used[np.unique(np.argmax(used @ directions.T, axis=0))]


@jit_allocating
def _draw(vertices: FloatArray, faces: IntArray, numbers: FloatArray, points: FloatArray, owners: IntArray) -> bool:
    """Fill ``points`` and ``owners``; False if the total area is not a positive finite number."""
    areas = np.empty(faces.shape[0])
    total = 0.0
    for face in range(faces.shape[0]):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        px = vertices[b, 0] - vertices[a, 0]
        py = vertices[b, 1] - vertices[a, 1]
        pz = vertices[b, 2] - vertices[a, 2]
        qx = vertices[c, 0] - vertices[a, 0]
        qy = vertices[c, 1] - vertices[a, 1]
        qz = vertices[c, 2] - vertices[a, 2]
        x, y, z = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
        areas[face] = np.sqrt(x * x + y * y + z * z)
        total += areas[face]
    if not (total > 0.0 and total < np.inf):
        return False
    count = numbers.shape[0]
    face = -1
    last = -1  # the last face with area so far
    before = 0.0  # area of the faces before `last`
    done = 0.0  # area of the faces up to `face`
    for sample in range(count):
        target = (sample + numbers[sample, 0]) / count * total
        while (last < 0 or target >= done) and face + 1 < faces.shape[0]:
            face += 1
            if areas[face] > 0.0:
                last = face
                before = done
                done += areas[face]
        # The position inside the face's share of the area is itself uniform and serves as one of its two coordinates.
        share = min(max((target - before) / areas[last], 0.0), 1.0)
        root = np.sqrt(share)
        wb = root * (1.0 - numbers[sample, 1])
        wc = root * numbers[sample, 1]
        wa = 1.0 - root
        a, b, c = faces[last, 0], faces[last, 1], faces[last, 2]
        for axis in range(3):
            points[sample, axis] = wa * vertices[a, axis] + wb * vertices[b, axis] + wc * vertices[c, axis]
        owners[sample] = last
    return True
