"""What makes a mesh an imperfect copy of its shape: other triangles, rounding, noise, details, holes, scans."""

from collections.abc import Callable
from itertools import product

import numpy as np

from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.meshes.subdivision import subdivide
from model.types import FloatArray, IntArray
from training.evaluation import corruptions
from training.inputs.depth import visible_part
from training.shapes.solids import random_rotation

Solid = tuple[FloatArray, IntArray]
Imperfection = Callable[[FloatArray, IntArray, np.random.Generator, float], Solid]
"""Vertices, faces, a source of chance and the diagonal of the bounding box to vertices and faces."""

GRID_CELLS = 62
"""Cells along the longest side of a remeshed shape; with the margin the grid has ten more."""

DETAIL = np.array([0.05, 0.03, 0.02])


def noise(share: float) -> Imperfection:
    """Independent noise along the vertex normals, its deviation a share of the diagonal."""

    def damage(vertices: FloatArray, faces: IntArray, rng: np.random.Generator, diagonal: float) -> Solid:
        vertices, faces = subdivide(vertices, faces, corruptions.LONGEST_EDGE * diagonal)
        heights = rng.normal(0.0, share * diagonal, len(vertices))
        return vertices + heights[:, None] * corruptions.vertex_normals(vertices, faces), faces

    return damage


def retriangulated(vertices: FloatArray, faces: IntArray, rng: np.random.Generator, diagonal: float) -> Solid:
    """Half of the faces cut into three at a random point."""
    weights = rng.dirichlet([2, 2, 2], len(faces))
    middles = (vertices[faces] * weights[..., None]).sum(1)
    cut = rng.random(len(faces)) < 0.5
    added = len(vertices) + np.arange(cut.sum())
    a, b, c = faces[cut].T
    pieces = [faces[~cut], *(np.stack([one, two, added], 1) for one, two in ((a, b), (b, c), (c, a)))]
    return np.concatenate([vertices, middles[cut]]), np.concatenate(pieces).astype(np.int32)


def quantised(vertices: FloatArray, faces: IntArray, rng: np.random.Generator, diagonal: float) -> Solid:
    """Coordinates rounded to 1/400 of the diagonal."""
    return np.round(vertices / (diagonal / 400)) * (diagonal / 400), faces


def decimated(vertices: FloatArray, faces: IntArray, rng: np.random.Generator, diagonal: float) -> Solid:
    """Vertices clustered; shapes of few faces are subdivided before."""
    if len(faces) < 400:
        vertices, faces = subdivide(vertices, faces, 0.04 * diagonal)
    return corruptions.decimate(vertices, faces, diagonal)


def remeshed(vertices: FloatArray, faces: IntArray, rng: np.random.Generator, diagonal: float) -> Solid:
    """The surface a little outside of the shape, by surface nets on a grid of its distance."""
    corners = vertices[faces].reshape(-1, 3)
    low, high = corners.min(0), corners.max(0)
    cell = (high - low).max() / GRID_CELLS
    origin = low - 5 * cell
    shape = tuple((np.ceil((high - low + 10 * cell) / cell).astype(int) + 1).tolist())
    grid = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1).reshape(-1, 3) * cell + origin
    field = np.sqrt(SurfaceIndex(vertices, faces).squared_distances(grid)).reshape(shape) - 1.2 * cell
    outside = np.zeros(shape, dtype=bool)
    outside[0] = True
    while True:  # what cannot be reached from outside is inside
        grown = outside.copy()
        for axis in range(3):
            for step in (1, -1):
                grown |= np.roll(outside, step, axis)
        grown &= field > 0
        if (grown == outside).all():
            break
        outside = grown
    return surface_nets(np.where(outside, field, -np.abs(field) - 1e-9 * cell), origin, cell)


def surface_nets(field: FloatArray, origin: FloatArray, cell: float) -> Solid:
    """The zero surface of a field on a grid: a vertex in each cell it passes, a quad across each edge."""
    inside, size = field < 0, np.array(field.shape)
    count, place = np.zeros(size - 1, dtype=int), np.zeros((*(size - 1), 3))
    for corner in product((0, 1), repeat=3):
        for axis in (axis for axis in range(3) if not corner[axis]):
            other = tuple(1 if k == axis else corner[k] for k in range(3))
            here, there = (field[tuple(slice(c[k], size[k] - 1 + c[k]) for k in range(3))] for c in (corner, other))
            crosses = (here < 0) != (there < 0)
            point = np.zeros((*crosses.shape, 3)) + corner
            point[..., axis] += np.divide(here, here - there, out=np.zeros_like(here), where=crosses)
            place += point * crosses[..., None]
            count += crosses
    index = np.where(count > 0, np.cumsum(count > 0).reshape(count.shape) - 1, -1)
    vertices = (np.argwhere(count > 0) + place[count > 0] / count[count > 0][:, None]) * cell + origin
    faces: list[IntArray] = []
    for axis in range(3):
        first, second = (k for k in range(3) if k != axis)
        crosses = np.diff(inside, axis=axis)
        cells = np.argwhere(crosses)
        within = (cells[:, [first, second]] > 0).all(1) & (cells[:, first] < size[first] - 1)
        cells = cells[within & (cells[:, second] < size[second] - 1)]
        quad = []
        for down_first, down_second in ((0, 0), (1, 0), (1, 1), (0, 1)):
            moved = cells.copy()
            moved[:, first] -= down_first
            moved[:, second] -= down_second
            quad.append(index[tuple(moved.T)])
        quads = np.stack(quad, 1)
        flip = inside[tuple(cells.T)] ^ (axis == 1)
        quads[flip] = quads[flip][:, ::-1]
        faces += [quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]
    return vertices, np.concatenate(faces).astype(np.int32)


def detailed(vertices: FloatArray, faces: IntArray, rng: np.random.Generator, diagonal: float) -> Solid:
    """A small box somewhere on the surface, turned at random."""
    place, _ = sample_surface(vertices, faces, 1, seed=int(rng.integers(1 << 30)))
    signs = np.array(list(product((-1, 1), repeat=3)))
    corners = signs * DETAIL / 2 * diagonal @ random_rotation(rng).T + place[0]
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    box = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], dtype=np.int32)
    return np.concatenate([vertices, corners]), np.concatenate([faces, box + len(vertices)])


def holed(radius: float) -> Imperfection:
    """A ball of triangles missing, its radius a share of the diagonal."""

    def damage(vertices: FloatArray, faces: IntArray, rng: np.random.Generator, diagonal: float) -> Solid:
        return corruptions.cut_ball(vertices, faces, rng, diagonal, radius)

    return damage


def scanned(views: int) -> Imperfection:
    """What so many depth images see."""

    def damage(vertices: FloatArray, faces: IntArray, rng: np.random.Generator, diagonal: float) -> Solid:
        return visible_part(vertices, faces, random_rotation(rng)[:views])

    return damage


KINDS: dict[str, Imperfection] = {
    "made": lambda vertices, faces, rng, diagonal: (vertices, faces),
    "retriangulated": retriangulated,
    "quantised": quantised,
    "decimated": decimated,
    "noise-0.1": noise(0.001),
    "noise-0.5": noise(0.005),
    "remeshed": remeshed,
    "detail": detailed,
    "hole-15": holed(0.15),
    "hole-25": holed(0.25),
    "hole-35": holed(0.35),
    "depth-1": scanned(1),
    "depth-3": scanned(3),
}
"""The place in this table is part of a kind's seed: new ones come last."""
