"""Uniform points on a surface, for symmetry errors and for training."""

import numpy as np

from model._jit import jit, kernel_array
from model.errors import DegenerateMeshError
from model.types import AnyArray, BoolArray, FloatArray, IntArray

_LOOKED_AT = 20_000


class SurfaceSampler:
    """Points distributed uniformly over a surface, with low variance.

    The surface, laid out face after face by area, is cut into strips of equal area and one point drawn in each. A face
    therefore receives its expected number of points, rounded up or down. The points come ordered by face: to take
    fewer, draw fewer, or take every k-th.

    Args:
        vertices: (v, 3) finite coordinates, any frame.
        faces: (f, 3) vertex indices; faces without area receive no points.

    Raises:
        DegenerateMeshError: no face has an area.
    """

    def __init__(self, vertices: FloatArray, faces: IntArray) -> None:
        self.vertices, self.faces = kernel_array(vertices, np.float64), kernel_array(faces, np.int32)
        self._areas = np.empty(len(faces))  # of the faces up to each
        total = _add_up(self.vertices, self.faces, self._areas)
        if not 0.0 < total < np.inf:
            raise DegenerateMeshError("The mesh has no surface area.")

    def draw(self, count: int, seed: int) -> tuple[FloatArray, IntArray]:
        """``count`` points.

        Args:
            count: number of points n.
            seed: the same seed gives the same points on every machine.

        Returns:
            (n, 3) float64 points in the frame of the vertices, and (n,) int32 indices of the faces they lie on.
        """
        points, owners = np.empty((count, 3)), np.empty(count, dtype=np.int32)
        numbers = np.random.Generator(np.random.PCG64(seed)).random((count, 2))
        _draw(self.vertices, self.faces, self._areas, numbers, points, owners)
        return points, owners


def sample_surface(vertices: FloatArray, faces: IntArray, count: int, seed: int) -> tuple[FloatArray, IntArray]:
    """What `SurfaceSampler.draw` gives, of a surface that is sampled once."""
    return SurfaceSampler(vertices, faces).draw(count, seed)


def extreme_vertices(vertices: FloatArray, faces: IntArray, directions: FloatArray) -> FloatArray:
    """The vertices that reach farthest in ``directions`` ``(d, 3)``, each once: ``(k, 3)``.

    They are the corners and rims by which flat and angular shapes are told from their turned copies, and which hardly
    any sample of the surface hits. Of very large meshes only a part of the vertices is looked at.
    """
    vertices, looked_at = kernel_array(vertices, np.float64), faces.ravel()[:: max(1, faces.size // _LOOKED_AT)]
    used = np.zeros(len(vertices), dtype=np.bool_)
    used[looked_at] = True
    farthest = np.empty(len(directions), dtype=np.int64)
    _find_farthest(vertices, used, kernel_array(directions, np.float64), farthest)
    return vertices[np.unique(farthest)]


@jit
def _area(vertices: FloatArray, faces: IntArray, face: int) -> float:
    """Twice the area of a face."""
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    px, py, pz = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2]
    qx, qy, qz = vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2]
    x, y, z = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
    return np.sqrt(x * x + y * y + z * z)


@jit
def _add_up(vertices: FloatArray, faces: IntArray, sums: FloatArray) -> float:
    """Fill ``sums`` ``(f,)`` with the area of the faces up to each; the total."""
    total = 0.0
    for face in range(faces.shape[0]):
        total += _area(vertices, faces, face)
        sums[face] = total
    return total


@jit
def _draw(
    vertices: FloatArray,
    faces: IntArray,
    sums: FloatArray,
    numbers: FloatArray,
    points: FloatArray,
    owners: IntArray,
) -> None:
    count, last = numbers.shape[0], sums.shape[0] - 1
    for sample in range(count):
        target = (sample + numbers[sample, 0]) / count * sums[last]
        # The first face up to which there is more; should rounding leave none, the last one with an area.
        face, end = 0, last
        while face < end:
            middle = (face + end) // 2
            if sums[middle] > target or sums[middle] == sums[last]:
                end = middle
            else:
                face = middle + 1
        # The position inside the face's share of the area is itself uniform and serves as one of its two coordinates.
        before = sums[face - 1] if face > 0 else 0.0
        share = min(max((target - before) / _area(vertices, faces, face), 0.0), 1.0)
        root = np.sqrt(share)
        wb = root * (1.0 - numbers[sample, 1])
        wc = root * numbers[sample, 1]
        wa = 1.0 - root
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        for axis in range(3):
            points[sample, axis] = wa * vertices[a, axis] + wb * vertices[b, axis] + wc * vertices[c, axis]
        owners[sample] = face


@jit
def _find_farthest(points: FloatArray, used: BoolArray, directions: FloatArray, farthest: AnyArray) -> None:
    """Fill ``farthest`` ``(d,)``: the first of the ``used`` points that reach farthest in each direction."""
    for direction in range(directions.shape[0]):
        x, y, z = directions[direction, 0], directions[direction, 1], directions[direction, 2]
        reach = -np.inf
        for point in range(points.shape[0]):
            if not used[point]:
                continue
            along = points[point, 0] * x + points[point, 1] * y + points[point, 2] * z
            if along > reach:
                reach, farthest[direction] = along, point
