"""Building blocks of the procedural shapes: meshes as ``(vertices (v, 3) float64, faces (f, 3) int32)``.

Every block keeps the symmetry it appears to have: caps are fans around a centre vertex and bent quads are
split around theirs, so that no diagonal favours one side. Faces look outwards.
"""

from itertools import combinations
from typing import TypeAlias

import numpy as np

from model.types import AnyArray, FloatArray, IntArray
from training.shapes.point_groups import rotation

Solid: TypeAlias = tuple[FloatArray, IntArray]


def merge(*solids: Solid) -> Solid:
    """Return one mesh of many bodies; they may interpenetrate."""
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in solids)])
    faces = [faces + start for (_, faces), start in zip(solids, starts, strict=False)]
    return np.concatenate([vertices for vertices, _ in solids]), np.concatenate(faces).astype(np.int32)


def moved(solid: Solid, matrix: FloatArray, translation: FloatArray | float = 0.0) -> Solid:
    """Return the solid under x ↦ ``matrix`` x + ``translation``, faces flipped by a reflection."""
    vertices, faces = solid
    faces = faces[:, ::-1] if np.linalg.det(matrix) < 0 else faces
    return vertices @ matrix.T + translation, np.ascontiguousarray(faces)


def orbit(solid: Solid, matrices: FloatArray) -> Solid:
    """Return the union of the solid's images under the group ``matrices`` (g, 3, 3): symmetric exactly."""
    return merge(*(moved(solid, matrix) for matrix in matrices))


def random_rotation(rng: np.random.Generator) -> FloatArray:
    """Return a rotation (3, 3) drawn uniformly from SO(3)."""
    w, x, y, z = (q := rng.normal(size=4)) / np.linalg.norm(q)
    half_angle = float(np.arctan2(np.sqrt(x * x + y * y + z * z), w))
    return rotation((x, y, z), 2.0 * half_angle)


def box(size: tuple[float, float, float], centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Solid:
    """Return an axis-aligned box: 8 vertices, 12 faces."""
    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [(a, b, c) for a, b, c, _ in quads] + [(a, c, d) for a, _, c, d in quads]
    return corners * size + centre, np.array(faces, dtype=np.int32)


def ring(
    n: int,
    z: float,
    *,
    radius: float = 1.0,
    inner: float | None = None,
    phase: float = 0.0,
    skew: float = 0.0,
) -> FloatArray:
    """Return a polygon around z, counter-clockwise, with a corner at the angle ``phase`` (radians).

    A regular n-gon, or with ``inner`` (a share of ``radius``) a star with n tips and as many notches;
    ``skew`` moves the notches from the middle by that share of the spacing, which takes the mirrors away.
    Returns (n or 2n, 3).
    """
    step = 2.0 * np.pi / n
    angles, radii = np.arange(n) * step, np.full(n, radius)
    if inner is not None:
        angles = np.stack([angles, angles + (0.5 + skew) * step], axis=1).ravel()
        radii = np.tile([radius, radius * inner], n)
    angles = angles + phase
    return np.stack([radii * np.cos(angles), radii * np.sin(angles), np.full(len(angles), z)], axis=1)


def loft(
    rings: list[FloatArray],
    *,
    ends: tuple[float, float] | None = None,
    closed: bool = False,
    bent: bool = True,
) -> Solid:
    """Return the surface through rings of equal length, from bottom to top.

    Args:
        rings: each (m, 3), counter-clockwise seen from above.
        ends: heights on the z axis of the centre of the bottom and the top fan; by default those of the end
            rings.
        closed: join the last ring to the first instead of capping them.
        bent: the quads are not flat: split each into four around its centre, else into two.
    """
    k, m = len(rings), len(rings[0])
    parts = [np.concatenate(rings)]
    count = k * m
    faces: list[AnyArray] = []
    here, after = np.arange(m), np.roll(np.arange(m), -1)
    for level in range(k if closed else k - 1):
        low, high = level * m, ((level + 1) % k) * m
        a, b, c, d = low + here, low + after, high + after, high + here
        if bent:
            parts.append((parts[0][a] + parts[0][b] + parts[0][c] + parts[0][d]) / 4.0)
            centre = count + here
            count += m
            faces += [np.stack([*edge, centre], axis=1) for edge in ((a, b), (b, c), (c, d), (d, a))]
        else:
            faces += [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    if not closed:
        low, high = ends if ends is not None else (rings[0][0, 2], rings[-1][0, 2])
        parts.append(np.array([[0.0, 0.0, low], [0.0, 0.0, high]]))
        last = (k - 1) * m
        faces.append(np.stack([after, here, np.full(m, count)], axis=1))
        faces.append(np.stack([last + here, last + after, np.full(m, count + 1)], axis=1))
    return np.concatenate(parts), np.concatenate(faces).astype(np.int32)


def revolve(
    profile: FloatArray, segments: int, *, ends: tuple[float, float] | None = None, closed: bool = False
) -> Solid:
    """Return a surface of revolution about z: ``profile`` (k, 2) of radius > 0 and height, bottom to top.

    A ``closed`` profile runs counter-clockwise in the (radius, height) half plane.
    """
    rings = [ring(segments, float(z), radius=float(r)) for r, z in profile]
    return loft(rings, ends=ends, closed=closed, bent=False)


def regular_solid(name: str) -> Solid:
    """Return a Platonic solid with its corners on the unit sphere, in the frame of ``group_matrices``."""
    golden = (1.0 + np.sqrt(5.0)) / 2.0
    if name == "tetrahedron":
        return _simplicial(np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]))
    if name == "octahedron":
        return _simplicial(np.concatenate([np.eye(3), -np.eye(3)]))
    if name == "icosahedron":
        corners = [(0.0, s, t * golden) for s in (-1, 1) for t in (-1, 1)]
        return _simplicial(np.array([np.roll(corner, shift) for corner in corners for shift in range(3)]))
    if name == "cube":
        return _dual(regular_solid("octahedron"))
    if name == "dodecahedron":
        return _dual(regular_solid("icosahedron"))
    raise ValueError(f"{name!r} is not a regular solid")


def geodesic_sphere(subdivisions: int) -> Solid:
    """Return the unit sphere as an icosahedron whose faces are quartered ``subdivisions`` times."""
    vertices, faces = regular_solid("icosahedron")
    for _ in range(subdivisions):
        edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        pairs, index = np.unique(edges, axis=0, return_inverse=True)
        middle = vertices[pairs].sum(axis=1)
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        ab, bc, ca = (len(vertices) + index.reshape(-1, 3)).T
        a, b, c = faces.T
        corners = [(a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc, ca)]
        faces = np.concatenate([np.stack(corner, axis=1) for corner in corners]).astype(np.int32)
        vertices = np.concatenate([vertices, middle])
    return vertices, faces


def irregular(rng: np.random.Generator) -> Solid:
    """Return a solid that no plane and no rotation maps to itself, not even roughly, inside the unit ball.

    Three tapering arms, near to perpendicular, clearly unequal in length and width, leave an irregular core:
    a mirror would have to exchange two arms or reverse one.
    """
    octahedron, faces = regular_solid("octahedron")
    core = octahedron * rng.uniform(0.2, 0.45, size=(6, 1)) + rng.normal(scale=0.03, size=(6, 3))
    bodies = [(core, faces)]
    for index, (length, width) in enumerate(((1.0, 0.16), (0.72, 0.26), (0.48, 0.12))):
        length, width = length * rng.uniform(0.93, 1.0), width * rng.uniform(0.85, 1.15)
        arm = loft([ring(4, 0.0, radius=width), ring(4, length * 0.97, radius=0.5 * width)], bent=False)
        onto_axis = np.roll(np.eye(3), index, axis=0)
        wobble = rotation(rng.normal(size=3), rng.uniform(0.1, 0.3))
        bodies.append(moved(arm, wobble @ onto_axis))
    return moved(merge(*bodies), random_rotation(rng))


def _simplicial(corners: FloatArray) -> Solid:
    """Return the regular polyhedron with triangular faces: its corners' triples that are pairwise nearest."""
    corners = corners / np.linalg.norm(corners, axis=1, keepdims=True)
    distance = np.linalg.norm(corners[:, None] - corners[None], axis=2)
    edge = distance[distance > 1e-9].min()
    triples = [
        t for t in combinations(range(len(corners)), 3) if all(distance[p] < edge + 1e-9 for p in combinations(t, 2))
    ]
    return corners, np.array([_outwards(corners, triple) for triple in triples], dtype=np.int32)


def _dual(solid: Solid) -> Solid:
    """Return the dual: a corner for each face, for each corner a face, split as a fan around its centre."""
    vertices, faces = solid
    corners = vertices[faces].mean(axis=1)
    corners /= np.linalg.norm(corners, axis=1, keepdims=True)
    centres = np.array([corners[(faces == i).any(axis=1)].mean(axis=0) for i in range(len(vertices))])
    points = np.concatenate([corners, centres])
    triangles: list[tuple[int, int, int]] = []
    for (f, first), (g, second) in combinations(enumerate(faces), 2):
        shared = np.intersect1d(first, second)
        if len(shared) == 2:  # neighbours across an edge: the dual edge bounds the fans of both of its ends
            triangles += [_outwards(points, (f, g, len(corners) + int(i))) for i in shared]
    return points, np.array(triangles, dtype=np.int32)


def _outwards(points: FloatArray, triple: tuple[int, ...]) -> tuple[int, int, int]:
    a, b, c = triple
    return (a, b, c) if np.linalg.det(points[[a, b, c]]) > 0 else (a, c, b)
