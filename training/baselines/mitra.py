"""Mitra, Guibas and Pauly 2006: partial and approximate symmetry detection, of reflections.

Surface points carry the principal curvatures of their neighbourhood, estimated from the mesh (normal cycles); points
whose curvatures are alike in all directions are dropped, for nothing distinguishes them. Every pair of points of
similar curvature votes for the plane that reflects one to the other, if it also reflects their normals. Mean shift
finds the modes of the votes in the space of planes. Each is refined on the votes near it and verified on the shape:
what counts is the share of the surface that the reflection maps to the surface, where the paper grows a connected
patch.
"""

import numpy as np
from scipy.spatial import KDTree

from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.geometry.transforms import reflect
from model.types import AnyArray, FloatArray, IntArray
from training.baselines._directions import distinct_lines

TITLE = "Mitra 2006"

POINTS = 1500
NEIGHBOURHOOD = 0.06
"""Radius, unit frame, that curvature is integrated over."""

UMBILIC = 0.75
"""Points whose principal curvatures have a ratio beyond this are dropped."""

SIMILAR = 0.1
"""Curvatures, relative to their size, that may pair; of each point the `PARTNERS` most similar ones are tried."""

PARTNERS = 60
ALIGNED = float(np.cos(np.deg2rad(15.0)))
"""Normals must be reflected to within 15 degrees."""

BANDWIDTH = 0.06
"""Of the mean shift, in the space of (n, d)."""

MOST = 10
LEAST = 0.2
"""Modes with less than this share of the largest one's votes are left out."""

COVERED = 0.01
"""Unit frame: so near to the surface, the image of a point lies on it."""

_SEGMENT = 0.02
_CLOSEST = 0.05
_SEEDS, _STEPS, _STILL = 150, 40, 1e-4
_VOTES, _SAMPLES = 40_000, 600
_SAME_PLANE = np.deg2rad(5.0)


def find_planes(vertices: FloatArray, faces: IntArray, rng: np.random.Generator) -> FloatArray:
    """`training.baselines.Baseline`."""
    points, owners = sample_surface(vertices, faces, POINTS, seed=int(rng.integers(2**32)))
    corners = vertices[faces[owners]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    curvatures = principal_curvatures(points, vertices, faces)
    size = np.abs(curvatures).max(1)
    ratio = np.abs(curvatures).min(1) / np.maximum(size, 1e-12)
    telling = (size > 1e-3 * size.max(initial=0.0)) & (ratio < UMBILIC)
    if telling.sum() < 2:  # nothing is curved, or everything alike
        return np.zeros((0, 4))
    points, normals, curvatures = points[telling], normals[telling], curvatures[telling]
    votes = _votes(points, normals, curvatures)
    if not len(votes):
        return np.zeros((0, 4))
    votes = votes[rng.permutation(len(votes))[:_VOTES]]
    planes = _modes(votes, rng)
    surface = SurfaceIndex(vertices, faces)
    samples, _ = sample_surface(vertices, faces, _SAMPLES, seed=int(rng.integers(2**32)))
    squared = np.array([surface.squared_distances(reflect(samples, plane)) for plane in planes])
    return planes[np.argsort(-(squared <= COVERED**2).mean(1), kind="stable")]


def principal_curvatures(points: FloatArray, vertices: FloatArray, faces: IntArray) -> FloatArray:
    """The two principal curvatures ``(n, 2)``, larger size first, of the surface about each point ``(n, 3)``.

    The curvature tensor is the sum, over the edges within `NEIGHBOURHOOD`, of dihedral angle times length times the
    edge's direction with itself, by the area of the disc (Cohen-Steiner and Morvan 2003). Edges are cut into segments
    that lie within or without as a whole.
    """
    tensors = np.zeros((len(points), 3, 3))
    middles, matrices = _bent_segments(vertices, faces)
    if len(middles):
        near = KDTree(middles).query_ball_point(points, NEIGHBOURHOOD)
        for row, segments in enumerate(near):
            tensors[row] = matrices[segments].sum(0)
    values = np.linalg.eigvalsh(tensors / (np.pi * NEIGHBOURHOOD**2))
    # One eigenvalue belongs to the normal and is nearly zero: the least in size.
    largest = np.argsort(-np.abs(values), axis=1, kind="stable")[:, :2]
    return np.take_along_axis(values, largest, axis=1).astype(np.float64)


def _bent_segments(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, AnyArray]:
    """Middles ``(s, 3)`` of pieces of the edges that two triangles share at an angle, and tensors ``(s, 3, 3)``."""
    _, place = np.unique(vertices, axis=0, return_inverse=True)
    welded = place.reshape(-1)[faces]
    corners = vertices[faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normal, axis=1)
    normal = np.divide(normal, area[:, None], out=np.zeros_like(normal), where=area[:, None] > 0)
    ends = np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)])
    keys = np.sort(np.concatenate([welded[:, [k, (k + 1) % 3]] for k in range(3)]), axis=1)
    owner = np.tile(np.arange(len(faces)), 3)
    order = np.lexsort((keys[:, 1], keys[:, 0]))
    same = (keys[order][1:] == keys[order][:-1]).all(1)
    first, second = order[:-1][same], order[1:][same]
    start, end = vertices[ends[first, 0]], vertices[ends[first, 1]]
    along = end - start
    length = np.linalg.norm(along, axis=1)
    sine = np.cross(normal[owner[first]], normal[owner[second]])
    angle = np.arctan2(np.linalg.norm(sine, axis=1), (normal[owner[first]] * normal[owner[second]]).sum(1))
    angle *= np.where((sine * along).sum(1) < 0, -1.0, 1.0)
    bent = (np.abs(angle) > 1e-6) & (np.abs(angle) < 3.0) & (length > 0)  # two sides of a sheet bend nowhere
    start, along, length, angle = start[bent], along[bent], length[bent], angle[bent]
    pieces = np.maximum(np.ceil(length / _SEGMENT).astype(np.int64), 1)
    edge = np.repeat(np.arange(len(pieces)), pieces)
    step = np.arange(len(edge)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    middles = start[edge] + ((step + 0.5) / pieces[edge])[:, None] * along[edge]
    unit = along[edge] / length[edge, None]
    return middles, (angle * length / pieces)[edge, None, None] * unit[:, :, None] * unit[:, None, :]


def _votes(points: FloatArray, normals: FloatArray, curvatures: FloatArray) -> FloatArray:
    """Planes (n, d) ``(k, 4)`` of the pairs that agree in curvature and in their normals."""
    sizes = np.abs(curvatures).max(1)
    scaled = curvatures / sizes.max()
    count = min(PARTNERS + 1, len(points))
    _, partners = KDTree(scaled).query(scaled, k=count)
    first = np.repeat(np.arange(len(points)), count)
    second = partners.reshape(-1)
    once = first < second  # most pairs find each other; the others are few
    first, second = first[once], second[once]
    gap = np.abs(curvatures[first] - curvatures[second]).max(1)
    similar = gap <= SIMILAR * np.maximum(sizes[first], sizes[second])
    first, second = first[similar], second[similar]
    across = points[second] - points[first]
    distance = np.linalg.norm(across, axis=1)
    far = distance > _CLOSEST
    first, second, across, distance = first[far], second[far], across[far], distance[far]
    direction = across / distance[:, None]
    image = normals[first] - 2.0 * (normals[first] * direction).sum(1, keepdims=True) * direction
    aligned = (image * normals[second]).sum(1) > ALIGNED
    direction, middle = direction[aligned], (points[first] + points[second])[aligned] / 2.0
    return np.column_stack([direction, -(direction * middle).sum(1)])


def _modes(votes: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Modes of the votes ``(k, 4)``, most votes first; (n, d) and (-n, -d) are one plane."""
    both = np.concatenate([votes, -votes])
    tree = KDTree(both)
    seeds = both[rng.permutation(len(votes))[:_SEEDS]]
    for _ in range(_STEPS):
        moved = np.array([both[near].mean(0) for near in tree.query_ball_point(seeds, BANDWIDTH)])
        moved /= np.linalg.norm(moved[:, :3], axis=1, keepdims=True)
        still = np.abs(moved - seeds).max() < _STILL
        seeds = moved
        if still:
            break
    counts = np.array([len(near) for near in tree.query_ball_point(seeds, BANDWIDTH)])
    order = np.argsort(-counts, kind="stable")
    lines = seeds / np.linalg.norm(seeds, axis=1, keepdims=True)
    kept = order[distinct_lines(lines[order], _SAME_PLANE)]
    kept = kept[counts[kept] >= LEAST * counts[kept[0]]][:MOST]
    return np.array([_refined(both, tree, seeds[row]) for row in kept])


def _refined(both: FloatArray, tree: KDTree, plane: FloatArray) -> FloatArray:
    """The mean of the votes within ever smaller neighbourhoods, as long as enough are left."""
    for radius in (BANDWIDTH / 2.0, BANDWIDTH / 4.0):
        near = tree.query_ball_point(plane, radius)
        if len(near) < 20:
            break
        plane = np.median(both[near], axis=0)
        plane = plane / np.linalg.norm(plane[:3])
    return plane
