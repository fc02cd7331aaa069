"""Polygons to triangles: fans where they cover a polygon, ear clipping where it is concave or has holes pinched in."""

from dataclasses import dataclass

import mapbox_earcut
import numpy as np

from model._jit import jit, kernel_array
from model.errors import MeshTooLargeError
from model.formats._common import Limits, as_indices
from model.geometry.straight_corners import signed_areas, with_straight_corners
from model.types import AnyArray, FloatArray, IntArray

_MOST_CORNERS = 20_000
"""Corners of a polygon that needs ear clipping, the time of which may grow with their square."""

_ROUNDING = 1e-12
"""Share of a polygon's area that is none."""

_MOST_CORNERS_OF_ANY = 100_000
"""Corners of any polygon: a fan of so many slivers is found too complex in the end, after seconds of work."""


@dataclass(frozen=True, slots=True)
class Triangles:
    """What became of polygons.

    Attributes:
        faces: (f, 3) int32 vertex indices.
        places: (f, 3) where each corner stands in the row of all corners; None for 0, 1, 2 and so on.
        crossing: how many polygons cross themselves.
    """

    faces: IntArray
    places: IntArray | None = None
    crossing: int = 0

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the caller should know about the polygons."""
        if not self.crossing:
            return ()
        some = "A polygon crosses its" if self.crossing == 1 else f"{self.crossing} polygons cross their"
        return (f"{some} own outline; which surface is meant there is a guess.",)


def triangulate(vertices: FloatArray, indices: AnyArray, lengths: AnyArray, limits: Limits) -> Triangles:
    """Triangles that cover polygons, whatever their outline, each in the orientation of its polygon.

    A polygon that is not planar is looked at along its area vector; of a bent quadrilateral the shorter diagonal is
    taken, which does not depend on where its list of corners starts. Corners on a straight edge are kept.

    Args:
        vertices: (v, 3) float64.
        indices: corners of all polygons in a row, any number type; those out of range are left for others to find.
        lengths: corners of each polygon; those with fewer than three have no triangle.
        limits: checked before the triangles are made.

    Raises:
        UnreadableMeshError: an index does not fit into 32 bits.
        MeshTooLargeError: more triangles than the limits allow, a polygon of more than 100,000 corners, or a
            concave one of more than 20,000.
    """
    lengths = kernel_array(lengths, np.int64)
    counts = np.maximum(lengths - 2, 0)
    limits.check(faces=int(counts.sum()))
    if len(lengths) and lengths.max() > _MOST_CORNERS_OF_ANY:
        raise MeshTooLargeError(f"A polygon has more than {_MOST_CORNERS_OF_ANY} corners; triangulate it.")
    corners = as_indices(indices)
    if len(lengths) == 0 or (lengths == 3).all():
        return Triangles(corners.reshape(-1, 3))
    places = np.empty((int(counts.sum()), 3), dtype=np.int32)
    odd = np.zeros(len(lengths), dtype=np.uint8)
    crossing = int(_cut(kernel_array(vertices, np.float64), corners, lengths, places, odd))
    concave = np.flatnonzero(odd)
    if len(concave):
        starts, rows = np.cumsum(lengths) - lengths, np.cumsum(counts) - counts
        kept = np.ones(len(places), dtype=np.bool_)
        for polygon in concave.tolist():
            start, length, row = int(starts[polygon]), int(lengths[polygon]), int(rows[polygon])
            if length > _MOST_CORNERS:
                raise MeshTooLargeError(f"A concave polygon has more than {_MOST_CORNERS} corners; triangulate it.")
            ears, crosses = _clip_ears(vertices[corners[start : start + length]])
            crossing += crosses
            places[row : row + len(ears)] = start + ears
            kept[row + len(ears) : row + length - 2] = False
        places = places[kept]
    return Triangles(corners[places], places, crossing)


@jit
def _cut(vertices: FloatArray, corners: IntArray, lengths: AnyArray, places: IntArray, odd: AnyArray) -> int:
    """Fill ``places`` where a fan or a diagonal will do, mark the other polygons; how many quadrilaterals cross."""
    start, face, crossing = 0, 0, 0
    for polygon in range(lengths.shape[0]):
        length = lengths[polygon]
        shift = 0
        if length > 3:
            verdict = _judge(vertices, corners, start, length)
            if length == 4:
                crossing += verdict == 2
                shift = verdict == 1
            elif verdict == 2:
                odd[polygon] = 1
        for corner in range(2, length):
            places[face, 0] = start + shift
            places[face, 1] = start + shift + corner - 1
            places[face, 2] = start + (shift + corner) % length
            face += 1
        start += length
    return crossing


@jit
def _judge(vertices: FloatArray, corners: IntArray, start: int, length: int) -> int:
    """0: a fan around the first corner covers the polygon; 1: one around the second does; 2: neither, or not known."""
    count = vertices.shape[0]
    for corner in range(length):
        index = corners[start + corner]
        if index < 0 or index >= count:
            return 0
    a = corners[start]
    nx, ny, nz = 0.0, 0.0, 0.0
    for corner in range(2, length):
        x, y, z = _cross(vertices, a, corners[start + corner - 1], corners[start + corner])
        nx, ny, nz = nx + x, ny + y, nz + z
    squared = nx * nx + ny * ny + nz * nz
    if not (squared > 0.0 and squared < np.inf):
        # Without an area, or not finite: of a quadrilateral only a bow tie is worth a word.
        return 2 if (length > 4 and squared == 0.0) or _is_bow_tie(vertices, corners, start, length) else 0
    least = -1e-7 * squared
    covered = True
    for corner in range(2, length):
        x, y, z = _cross(vertices, a, corners[start + corner - 1], corners[start + corner])
        covered = covered and x * nx + y * ny + z * nz >= least
    x, y, z = _cross(vertices, corners[start + length - 1], a, corners[start + 1])
    covered = covered and x * nx + y * ny + z * nz >= least
    if length > 4:
        return 0 if covered else 2
    # A quadrilateral needs less: two triangles of one orientation along either diagonal.
    x, y, z = _cross(vertices, a, corners[start + 1], corners[start + 2])
    u, v, w = _cross(vertices, a, corners[start + 2], corners[start + 3])
    first = min(x * nx + y * ny + z * nz, u * nx + v * ny + w * nz) >= least
    x, y, z = _cross(vertices, corners[start + 1], corners[start + 2], corners[start + 3])
    u, v, w = _cross(vertices, corners[start + 1], corners[start + 3], a)
    second = min(x * nx + y * ny + z * nz, u * nx + v * ny + w * nz) >= least
    if not second:
        return 0 if first else 2
    if not first:
        return 1
    here = _squared_distance(vertices, a, corners[start + 2])
    there = _squared_distance(vertices, corners[start + 1], corners[start + 3])
    third, fourth = corners[start + 2], corners[start + 3]
    height = 0.0  # of the fourth corner over the plane of the others, times twice the area of their triangle
    x, y, z = _cross(vertices, a, corners[start + 1], third)
    height = x * (vertices[fourth, 0] - vertices[a, 0])
    height += y * (vertices[fourth, 1] - vertices[a, 1])
    height += z * (vertices[fourth, 2] - vertices[a, 2])
    # Bent: farther from that plane than 1e-5 of a diagonal.
    bent = height * height > 1e-10 * max(here, there) * (x * x + y * y + z * z)
    return 1 if bent and there < here * (1.0 - 1e-6) else 0


@jit
def _is_bow_tie(vertices: FloatArray, corners: IntArray, start: int, length: int) -> bool:
    """Whether a quadrilateral without area vector has corners that are not on one line."""
    x, y, z = _cross(vertices, corners[start], corners[start + 1], corners[start + 2])
    return length == 4 and x * x + y * y + z * z > 0.0


@jit
def _cross(vertices: FloatArray, a: int, b: int, c: int) -> tuple[float, float, float]:
    """Twice the area vector of a triangle."""
    px, py, pz = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2]
    qx, qy, qz = vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2]
    return py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx


@jit
def _squared_distance(vertices: FloatArray, a: int, b: int) -> float:
    x, y, z = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2]
    return x * x + y * y + z * z


def _clip_ears(points: FloatArray) -> tuple[IntArray, bool]:
    """Triangles (t, 3) as places in the ring of points (n, 3), and whether the ring crosses itself."""
    flat, area = _project(points - points[0])
    count = len(flat)
    ears = mapbox_earcut.triangulate_float64(flat, np.array([count], dtype=np.uint32)).reshape(-1, 3).astype(np.int64)
    areas = signed_areas(flat, ears)
    turned = areas < -_ROUNDING * float(np.abs(areas).sum())  # not those without area: they keep neighbours joined
    ears[turned] = ears[turned][:, ::-1]
    crosses = abs(float(np.abs(areas).sum()) - area) > 1e-6 * max(float(np.abs(areas).sum()), area)
    if len(ears) < count - 2:
        ears = with_straight_corners(flat, ears, np.roll(np.arange(count), -1), area)[: count - 2]
    return ears.astype(np.int32), crosses


def _project(points: FloatArray) -> tuple[FloatArray, float]:
    """The ring (n, 3) seen along its area vector, counter-clockwise: (n, 2) coordinates; and its area."""
    crosses = np.cross(points[1:-1], points[2:])
    normal = crosses.sum(axis=0)
    area = float(np.linalg.norm(normal))
    if area <= 1e-9 * float(np.abs(crosses).sum()):  # its loops cancel out: look at it along its largest triangle
        normal = crosses[int(np.argmax(np.einsum("ij,ij->i", crosses, crosses)))]
    length = float(np.linalg.norm(normal))
    normal = normal / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    across = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
    across /= np.linalg.norm(across)
    return np.ascontiguousarray(points @ np.stack([across, np.cross(normal, across)], axis=1)), area / 2.0
