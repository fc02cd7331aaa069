"""A surface through a point cloud: what lets everything that is made for meshes work on scans.

Triangles join points that are neighbours: around every point those of the Delaunay triangulation of its neighbours in
its tangent plane, as far as they are not much larger than the local spacing. Where points disagree on a diagonal some
triangles overlap, so that no edge is open that lies inside the surface. The rim of the cloud is an open boundary,
beyond which nothing was seen. Points are moved only where noise is as large as the spacing.
"""

from dataclasses import dataclass

import numpy as np

from model.errors import DegenerateMeshError, EmptyMeshError
from model.meshes import _point_kernels as _kernels
from model.types import AnyArray, FloatArray, IntArray

FEWEST_POINTS = 50
"""Fewer do not show a surface."""

MOST_POINTS = 20_000
"""Larger clouds are thinned to so many, evenly: more than the judgement looks at."""

_NEIGHBOURS = 20
"""Some 6 of the nearest are neighbours in a triangulation; of unevenly strewn points a few of the next."""

_SPACING = 6
"""The distance of the so many-th neighbour is the local spacing: 1.4 edges of a square of a point's share of area."""

_NORMAL_NEIGHBOURS = 12
_NOISY = 0.12
"""Where the neighbours of most points scatter about their plane by more than this share of the spacing, it is noise:
the points are moved onto the planes, without which triangles would fold over each other."""

_MANY = 1000
"""Fewer points may scatter because the shape itself bends as much between them."""

_PASSES = 3
_ALONE = 2.5
"""A point whose neighbours are so many times farther than theirs is an outlier."""

_FEW = 5
"""So is one that is among the nearest of fewer other points: a point of the surface is among those of some twenty."""

_SPARSE = 8.0
"""And one whose neighbours are so many times farther than those of most points."""

_FAR, _CORE = 4.0, 0.95
"""Beyond so many radii of that share of all points, too."""

_FINEST = 1.0 / 2048
"""Of the extent: points nearer to each other are one."""

_ROUNDS = 3
_GROWTH = 1.12


@dataclass(frozen=True, slots=True, eq=False)
class PointSurface:
    """Points ``(n, 3)`` with triangles ``(f, 3)`` between them, and how many points of the cloud were left out.

    ``outliers`` stood alone, ``broken`` were no finite numbers, ``thinned`` stood close to others.
    """

    vertices: FloatArray
    faces: IntArray
    outliers: int
    broken: int
    thinned: int


def surface_of_points(points: FloatArray, largest: float) -> PointSurface:
    """Join a point cloud to a surface.

    Args:
        points: ``(n, 3)``, any frame; duplicates, outliers and uneven density are tolerated.
        largest: coordinates beyond are broken.

    Raises:
        EmptyMeshError: there are fewer than `FEWEST_POINTS` points, or none of them have neighbours.
        DegenerateMeshError: the points coincide.
    """
    usable = points[(np.abs(points) <= largest).all(1)]  # NaN is not
    broken = len(points) - len(usable)
    _require(len(usable))
    middle = np.median(usable, axis=0)
    away = np.abs(usable - middle).max(1)
    near = usable[away <= _FAR * np.quantile(away, _CORE)]
    outliers = len(usable) - len(near)
    low = near.min(0)
    extent = float((near - low).max())
    if not extent > 0.0:
        raise DegenerateMeshError("All points of the cloud coincide; it has no extent.")
    kept = _thinned((near - low) / extent)
    _require(len(kept))
    # Kernels work in units of the extent.
    unit = (near[kept] - low) / extent
    neighbours, squared = _nearest(unit)
    reach = np.sqrt(squared[:, _SPACING - 1])
    asked_for = np.bincount(neighbours.ravel(), minlength=len(unit))
    alone = (reach > _ALONE * np.median(reach[neighbours[:, :_SPACING]], axis=1)) | (asked_for < _FEW)
    alone |= reach > _SPARSE * np.median(reach)
    if alone.any():
        outliers += int(alone.sum())
        kept, unit = kept[~alone], unit[~alone]
        _require(len(kept))
        neighbours, squared = _nearest(unit)
    normals, scatter = _tangents(unit, neighbours)
    noise = np.median(scatter / np.sqrt(squared[:, _SPACING - 1]))
    if len(unit) >= _MANY and noise > _NOISY:
        for _ in range(_PASSES):
            unit = unit + _to_plane(unit, neighbours, normals)
            normals, _ = _tangents(unit, neighbours)
        neighbours, squared = _nearest(unit)
    spacing = np.sqrt(squared[:, _SPACING - 1])
    stars = np.full((len(unit) * (_NEIGHBOURS + 1), 3), -1, dtype=np.int32)
    count = _kernels.join_stars(unit, normals, neighbours, spacing, stars)
    faces = _agreed(stars[:count])
    if not len(faces):
        raise EmptyMeshError("The points of the cloud lie too unevenly to show a surface.")
    _orient(unit, faces, normals, neighbours)
    thinned = len(near) - len(kept) - (outliers - (len(usable) - len(near)))
    return PointSurface(low + extent * unit, faces, outliers, broken, thinned)


def _require(count: int) -> None:
    if count < FEWEST_POINTS:
        raise EmptyMeshError(
            f"The file has no faces, and {count} different points are too few to show a surface: "
            f"there have to be {FEWEST_POINTS}."
        )


def _thinned(unit: FloatArray) -> AnyArray:
    """Rows of the points that are kept: one a cell, of cells as small as `MOST_POINTS` allow."""
    cell = _FINEST
    while True:
        places = np.floor(unit / cell).astype(np.int64)
        keys = (places[:, 0] << 42) | (places[:, 1] << 21) | places[:, 2]
        _, kept = np.unique(keys, return_index=True)
        if len(kept) <= MOST_POINTS:
            return np.sort(kept)
        cell *= max(_GROWTH, (len(kept) / MOST_POINTS) ** 0.4)


def _nearest(unit: FloatArray) -> tuple[AnyArray, FloatArray]:
    """The nearest neighbours of every point ``(n, k)``, nearest first, and their squared distances."""
    side = max(1, min(128, int(len(unit) ** (1.0 / 3.0))))
    places = np.minimum((unit * side).astype(np.int64), side - 1)
    cells = (places[:, 0] * side + places[:, 1]) * side + places[:, 2]
    order = np.argsort(cells, kind="stable")
    starts = np.searchsorted(cells[order], np.arange(side**3 + 1))
    neighbours = np.empty((len(unit), _NEIGHBOURS), dtype=np.int64)
    squared = np.empty((len(unit), _NEIGHBOURS))
    _kernels.find_nearest(unit, places, order, starts, side, neighbours, squared)
    return neighbours, squared


def _tangents(unit: FloatArray, neighbours: AnyArray) -> tuple[FloatArray, FloatArray]:
    """The direction in which each point's neighbours spread least, ``(n, 3)``, and how much they do ``(n,)``.

    The sign of a direction is arbitrary.
    """
    around = unit[neighbours[:, :_NORMAL_NEIGHBOURS]]
    around = around - around.mean(1, keepdims=True)
    values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))
    scatter = np.sqrt(np.maximum(values[:, 0], 0.0) / _NORMAL_NEIGHBOURS)
    return np.ascontiguousarray(vectors[:, :, 0]), scatter


def _to_plane(unit: FloatArray, neighbours: AnyArray, normals: FloatArray) -> FloatArray:
    """The way from each point along its normal to the plane through its neighbours, ``(n, 3)``."""
    away = unit[neighbours[:, :_NORMAL_NEIGHBOURS]].mean(1) - unit
    return np.einsum("ni,ni->n", away, normals)[:, None] * normals


def _agreed(stars: IntArray) -> IntArray:
    """The triangles ``(f, 3)`` that two corners ask for, and of the others those that close an edge left open."""
    ends = np.sort(stars, axis=1).astype(np.int64)
    keys = (ends[:, 0] << 42) | (ends[:, 1] << 21) | ends[:, 2]
    _, first, votes = np.unique(keys, return_index=True, return_counts=True)
    faces, edges = stars[first], ends[first][:, [[0, 1], [1, 2], [0, 2]]]
    _, edge = np.unique((edges[..., 0] << 21) | edges[..., 1], return_inverse=True)
    edge = edge.reshape(-1, 3)
    chosen = votes > 1
    for _ in range(_ROUNDS):
        is_open = np.bincount(edge[chosen].ravel(), minlength=edge.max(initial=-1) + 1) == 1
        chosen = chosen | is_open[edge].any(1)
    return np.ascontiguousarray(faces[chosen])


def _orient(unit: FloatArray, faces: IntArray, normals: FloatArray, neighbours: AnyArray) -> None:
    """Turn the faces so that all look to one side, as far as the surface has two: outwards, by its volume.

    Signs spread from neighbour to neighbour, first where normals agree best (Hoppe et al. 1992).
    """
    first = np.repeat(np.arange(len(unit)), _SPACING)
    second = neighbours[:, :_SPACING].ravel()
    agreement = np.einsum("ij,ij->i", normals[first], normals[second])
    order = np.argsort(-np.abs(agreement), kind="stable")
    signs = np.empty(len(unit), dtype=np.int64)
    parts = np.empty(len(unit), dtype=np.int64)
    _kernels.spread_signs(first[order], second[order], agreement[order], signs, parts)
    corners = unit[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flip = np.einsum("ij,ij->i", cross, normals[faces[:, 0]]) * signs[faces[:, 0]] < 0.0
    part = parts[faces[:, 0]]
    area = np.sqrt(np.square(cross).sum(1))
    middle = corners.mean(1)
    centre = (middle * area[:, None]).sum(0) / max(float(area.sum()), 1e-300)
    volume = np.bincount(part, np.where(flip, -1.0, 1.0) * np.einsum("ij,ij->i", cross, middle - centre), len(unit))
    flip ^= volume[part] < 0.0
    faces[flip] = faces[flip][:, [0, 2, 1]]
