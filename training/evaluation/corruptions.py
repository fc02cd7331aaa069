"""What `training evaluate` does to a shape before it is shown to a detector: poses, noise, holes, decimation.

Everything follows from (seed, index of the shape) alone. All sizes are shares of the bounding box' diagonal in the
file's own pose.
"""

from dataclasses import dataclass

import numpy as np

from model.geometry.frames import UnitFrame, triangle_areas
from model.geometry.sampling import sample_surface
from model.meshes.subdivision import edge_lengths, halve_edges, subdivide
from model.types import FloatArray, IntArray
from training.inputs.depth import visible_part
from training.shapes.solids import random_rotation

DAMAGES = ("clean", "rotated", "noisy", "partial", "decimated", "ball25", "ball35", "depth1", "depth3")
"""``clean``: pose as in the file. All others, ``rotated`` alone for comparison, are shown in a random pose.

``partial``, ``ball25`` and ``ball35`` lack what lies in a ball; ``depth1`` and ``depth3`` keep what so many depth
images see. The place in this list is part of a damage's seed: new ones come last."""

NOISE = 0.005
"""Standard deviation of the noise along the vertex normals."""

HOLE = 0.15
"""Radius of the ball that is removed."""

_HOLES = {"partial": HOLE, "ball25": 0.25, "ball35": 0.35}
_VIEWS = {"depth1": 1, "depth3": 3}

LONGEST_EDGE = 0.06
"""Longer edges are halved before noise. Twelve standard deviations of the noise: its values then tilt a triangle by
some ten degrees, rough as a scan is, without folding it over. A box gets a few thousand faces with independent noise,
instead of eight corners whose noise would tilt whole sides."""

RIM_EDGE = HOLE / 4
"""Longer edges that the rim of a hole passes are halved before the hole is cut."""

KEPT_FACES = 0.25
"""Decimation looks for the smallest cell that leaves at most this share of the faces."""

CELLS = (0.005, 0.007, 0.01, 0.014, 0.02, 0.028, 0.04)
"""Cells that decimation tries; shapes of few faces stay above `KEPT_FACES` with the largest."""

_KEPT_AREA = 0.3
_TRIES = 10


@dataclass(frozen=True, slots=True, eq=False)
class Similarity:
    """``shown = scale * rotation @ unit + translation``: where the unit frame of the intact shape has gone to."""

    rotation: FloatArray
    translation: FloatArray
    scale: float

    def to_shown(self, points: FloatArray) -> FloatArray:
        """Points ``(n, 3)`` of the unit frame as they are shown."""
        return np.ascontiguousarray(self.scale * points @ self.rotation.T + self.translation)

    def planes_to_shown(self, planes: FloatArray) -> FloatArray:
        """Planes ``(k, 4)`` of the unit frame, rows (n, d), as they are shown."""
        normals = planes[:, :3] @ self.rotation.T
        return np.column_stack([normals, planes[:, 3] * self.scale - normals @ self.translation])

    def planes_to_unit(self, planes: FloatArray) -> FloatArray:
        """Planes as shown ``(k, 4)``, rows (n, d), in the unit frame."""
        normals = planes[:, :3] @ self.rotation
        offsets = (planes[:, 3] + planes[:, :3] @ self.translation) / self.scale
        return np.column_stack([normals, offsets])

    def points_to_unit(self, points: FloatArray) -> FloatArray:
        """Points as shown ``(..., 3)`` in the unit frame."""
        return (points - self.translation) @ self.rotation / self.scale

    def directions_to_unit(self, directions: FloatArray) -> FloatArray:
        """Directions as shown ``(..., 3)`` in the unit frame."""
        return directions @ self.rotation


@dataclass(frozen=True, slots=True, eq=False)
class CorruptedShape:
    """What a detector gets to see: ``vertices`` ``(v, 3)``, ``faces`` ``(f, 3)``, and the way back."""

    vertices: FloatArray
    faces: IntArray
    similarity: Similarity


def corrupt(vertices: FloatArray, faces: IntArray, damage: str, seed: int, index: int) -> CorruptedShape:
    """A shape as one of `DAMAGES`.

    Args:
        vertices: ``(v, 3)`` in the file's own coordinates.
        faces: ``(f, 3)``.
        damage: one of `DAMAGES`.
        seed: of the evaluation.
        index: of the shape. Its pose (turned, moved by some diameters, scaled) is the same for every damage.

    Raises:
        ValueError: there is no such damage.
    """
    if damage not in DAMAGES:
        raise ValueError(f"damage is one of {', '.join(DAMAGES)}, not {damage!r}")
    frame = UnitFrame.of(vertices, faces)
    if damage == "clean":
        return CorruptedShape(vertices, faces, Similarity(np.eye(3), frame.center, frame.scale))
    rng = np.random.default_rng([seed, index])
    scale = float(10.0 ** rng.uniform(-1.0, 1.0))
    similarity = Similarity(random_rotation(rng), scale * rng.normal(size=3), scale)
    diagonal = _diagonal(vertices[faces]) * scale / frame.scale
    shown = similarity.to_shown(frame.to_unit(vertices))
    rng = np.random.default_rng([seed, index, DAMAGES.index(damage)])
    if damage == "noisy":
        shown, faces = add_noise(shown, faces, rng, diagonal)
    elif damage in _HOLES:
        shown, faces = cut_ball(shown, faces, rng, diagonal, _HOLES[damage])
    elif damage in _VIEWS:
        shown, faces = visible_part(shown, faces, random_rotation(rng)[: _VIEWS[damage]])
    elif damage == "decimated":
        shown, faces = decimate(shown, faces, diagonal)
    return CorruptedShape(shown, faces, similarity)


def add_noise(
    vertices: FloatArray, faces: IntArray, rng: np.random.Generator, diagonal: float | None = None
) -> tuple[FloatArray, IntArray]:
    """Move every vertex along its normal by Gaussian noise; vertices at one place move together.

    Edges over `LONGEST_EDGE` are halved first. Returns the vertices and faces of the new mesh; ``diagonal`` is that of
    the bounding box of ``vertices`` unless given.
    """
    diagonal = diagonal or _diagonal(vertices[faces])
    vertices, faces = subdivide(*_merged(vertices, faces), LONGEST_EDGE * diagonal)
    heights = rng.normal(0.0, NOISE * diagonal, len(vertices))
    return vertices + heights[:, None] * vertex_normals(vertices, faces), faces


def cut_ball(
    vertices: FloatArray,
    faces: IntArray,
    rng: np.random.Generator,
    diagonal: float | None = None,
    hole: float = HOLE,
) -> tuple[FloatArray, IntArray]:
    """Remove the triangles whose centroid lies in a ball about a random surface point, its radius ``hole``.

    Edges over `RIM_EDGE` that the rim passes are halved first: of a box of twelve triangles a piece goes, not a side.
    If less than 30 % of the area would be left other points are tried; after ten the mesh stays whole.
    """
    diagonal = diagonal or _diagonal(vertices[faces])
    radius = hole * diagonal
    area = triangle_areas(vertices[faces]).sum()
    for _ in range(_TRIES):
        centre = sample_surface(vertices, faces, 1, seed=int(rng.integers(2**32)))[0][0]
        cut_vertices, cut = _subdivide_rim(vertices, faces, centre, radius, RIM_EDGE * diagonal)
        middle = cut_vertices[cut].mean(1)
        cut = cut[np.linalg.norm(middle - centre, axis=1) >= radius]
        if triangle_areas(cut_vertices[cut]).sum() >= _KEPT_AREA * area:
            used, cut = np.unique(cut, return_inverse=True)
            return cut_vertices[used], np.ascontiguousarray(cut.reshape(-1, 3), dtype=np.int32)
    return vertices, faces


def decimate(vertices: FloatArray, faces: IntArray, diagonal: float | None = None) -> tuple[FloatArray, IntArray]:
    """Vertex clustering: one vertex a cell of a grid, where it is nearest to the planes of the cell's triangles.

    The grid stands along the axes, so a shape in a random pose is not cut along its own symmetries. The vertex
    minimises the sum of the squared distances from these planes, weighted by area (a quadric; flat stays flat, sharp
    stays sharp), in directions they leave open it is the mean of the cell's vertices. The smallest of `CELLS` is
    taken that leaves at most `KEPT_FACES` of the faces, else the largest that leaves a surface.
    """
    diagonal = diagonal or _diagonal(vertices[faces])
    vertices, faces = _merged(vertices, faces)
    result = vertices, faces
    for cell in CELLS:
        coarse = _clustered(vertices, faces, cell * diagonal)
        if not triangle_areas(coarse[0][coarse[1]]).sum() > 0.0:
            break
        result = coarse
        if len(coarse[1]) <= KEPT_FACES * len(faces):
            break
    return result


def vertex_normals(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """``(v, 3)`` unit normals, the mean of the adjoining triangles weighted by area; zero where there is no area.

    Where the two sides of a sheet share their vertices the mean vanishes; one triangle's normal is taken.
    """
    corners = vertices[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1)
    total, weight, one = np.zeros_like(vertices), np.zeros(len(vertices)), np.zeros_like(vertices)
    for corner in faces.T:
        np.add.at(total, corner, cross)
        np.add.at(weight, corner, area)
        one[corner[area > 0]] = cross[area > 0]
    vanished = np.linalg.norm(total, axis=1) < 1e-6 * weight
    total[vanished] = one[vanished]
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.divide(total, length, out=np.zeros_like(total), where=length > 0)


def _subdivide_rim(
    vertices: FloatArray, faces: IntArray, centre: FloatArray, radius: float, longest: float
) -> tuple[FloatArray, IntArray]:
    while True:
        corners = vertices[faces]
        middle = corners.mean(1)
        reach = np.linalg.norm(corners - middle[:, None], axis=2).max(1)
        on_rim = np.abs(np.linalg.norm(middle - centre, axis=1) - radius) < reach
        wanted = on_rim[:, None] & (edge_lengths(vertices, faces) > longest)
        if not wanted.any():
            return vertices, faces
        vertices, faces, _ = halve_edges(vertices, faces, wanted)


def _clustered(vertices: FloatArray, faces: IntArray, cell: float) -> tuple[FloatArray, IntArray]:
    places = np.floor(vertices / cell).astype(np.int64)
    _, cluster, sizes = np.unique(places, axis=0, return_inverse=True, return_counts=True)
    cluster = cluster.reshape(-1)
    count = len(sizes)
    mean = np.stack([np.bincount(cluster, column, count) for column in vertices.T], axis=1) / sizes[:, None]
    corners = vertices[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1)
    normal = np.divide(cross, area[:, None], out=np.zeros_like(cross), where=area[:, None] > 0)
    matrix, vector = np.zeros((count, 3, 3)), np.zeros((count, 3))
    for corner in faces.T:
        owner = cluster[corner]
        height = np.einsum("fi,fi->f", normal, corners[:, 0] - mean[owner])
        np.add.at(matrix, owner, area[:, None, None] * normal[:, :, None] * normal[:, None, :])
        np.add.at(vector, owner, (area * height)[:, None] * normal)
    values, basis = np.linalg.eigh(matrix)
    # A direction in which the planes hardly differ is open: solving along it would shoot far out of the cell.
    held = values > np.maximum(1e-2 * values[:, -1:], 1e-300)
    step = np.einsum("kji,kj->ki", basis, vector)
    step = np.einsum("kij,kj->ki", basis, np.divide(step, values, out=np.zeros_like(step), where=held))
    outside = np.abs(step).max(1, initial=0.0) > cell
    step[outside] = 0.0
    coarse = cluster[faces]
    kept = (coarse[:, 0] != coarse[:, 1]) & (coarse[:, 1] != coarse[:, 2]) & (coarse[:, 2] != coarse[:, 0])
    # Triangles that have become the same are listed once; which way they look is kept.
    order = np.argmin(coarse, axis=1)[:, None]
    turned = np.take_along_axis(coarse, (order + np.arange(3)) % 3, axis=1)
    unique = np.unique(turned[kept], axis=0)
    return mean + step, np.ascontiguousarray(unique.reshape(-1, 3), dtype=np.int32)


def _merged(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, IntArray]:
    """Vertices at one place made one, unused ones dropped, triangles that are lines dropped."""
    used, local = np.unique(faces, return_inverse=True)
    places, inverse = np.unique(vertices[used], axis=0, return_inverse=True)
    merged = inverse.reshape(-1)[local.reshape(-1, 3)].astype(np.int32)
    a, b, c = merged.T
    return places, np.ascontiguousarray(merged[(a != b) & (b != c) & (c != a)])


def _diagonal(corners: FloatArray) -> float:
    return float(np.linalg.norm(corners.max((0, 1)) - corners.min((0, 1))))
