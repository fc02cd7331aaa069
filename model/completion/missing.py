"""Which part of a mirrored surface is missing in the original (the paper, Section 6: shape completion).

A point of the mirrored surface is missing where it lies farther than a tolerance from the original, by exact distances.
Triangles are judged at points spread over them; those that are missing in part are cut smaller and then along the
line where the distance is the tolerance.
"""

from dataclasses import dataclass

import numpy as np

from model._jit import kernel_array
from model.errors import TooComplexError
from model.geometry.frames import triangle_areas
from model.geometry.surface import SurfaceIndex
from model.geometry.topology import connected_parts, distinct_faces, duplicate_vertex_map
from model.meshes.clipping import clip, remove_unreferenced_vertices
from model.meshes.subdivision import edge_lengths, halve_edges
from model.types import BoolArray, FloatArray, IntArray

SMALLEST_TOLERANCE = 1e-4
"""Unit frame. What is nearer to its mirror image than this is there: a hair's breadth, of which the seam is made up."""

LARGEST_TOLERANCE = 0.02
_NOISE_FACTOR = 3.0
_FEW = 0.1
SIGNIFICANT = 0.005
"""Unit frame. A missing part that is nowhere farther from the original than this is a difference of modelling."""

FINEST_EDGE = 0.015
"""Unit frame. Triangles on the border of a missing part are not cut smaller than this."""

_SAME_PLACE, _SHIFT = 1e-7, 0.3819660112501051
"""Corners in one cell of a grid of this width are the same. Its origin is shifted: round coordinates lie within."""

_SPACING = 0.02
_THIN = 0.9
_MOST_POINTS = 300_000
_CLOSE, _MOST_STEPS = 1e-9, 120
"""Unit frame: how exactly the border of what is missing is found; and after how many steps it is at the latest."""

_MOST_FACES, _FACES_A_FACE = 300_000, 4
"""Cutting may make so many faces, and so many of each there was."""

# Steps of the plane's most even sequence of points (the plastic number's powers).
_STEP = np.array([0.7548776662466927, 0.5698402909980532])


@dataclass(frozen=True, slots=True, eq=False)
class MissingRegion:
    """The missing part: ``vertices`` ``(v, 3)``, ``faces`` ``(f, 3)``, which vertices are ``on_border`` ``(v,)``."""

    vertices: FloatArray
    faces: IntArray
    on_border: BoolArray


def estimate_tolerance(distances: FloatArray) -> float:
    """How far a mirrored surface lies from the original where both are there, by ``distances`` ``(n,)`` of samples.

    Three times the median distance of those samples that lie near it, within bounds; where hardly any does (of a half,
    say, that was cut at the plane), there is nothing to learn from, and it is the smallest.
    """
    near = distances[distances < LARGEST_TOLERANCE]
    if len(near) < _FEW * len(distances):
        return SMALLEST_TOLERANCE
    return float(np.clip(_NOISE_FACTOR * np.median(near), SMALLEST_TOLERANCE, LARGEST_TOLERANCE))


def find_missing(
    surface: SurfaceIndex, own: FloatArray, vertices: FloatArray, faces: IntArray, tolerance: float
) -> MissingRegion:
    """The part of a mirrored surface that the original one lacks, all in the unit frame.

    Args:
        surface: the original.
        own: ``(v, 3)`` its vertices.
        vertices: ``(v, 3)`` of the mirrored one.
        faces: ``(f, 3)`` of both, whichever way round.
        tolerance: what is nearer to the original is there.

    Raises:
        TooComplexError: long thin triangles would have to be cut into too many.
    """
    spacing = max(_SPACING, float(np.sqrt(triangle_areas(vertices[faces]).sum() / _MOST_POINTS)))
    significant = max(SIGNIFICANT, 2.0 * tolerance)
    faces, known = _known_first(own, vertices, faces)
    missing, partly, deep = (np.zeros(known, dtype=np.bool_) for _ in range(3))
    new = np.arange(known, len(faces))
    most = _MOST_FACES + _FACES_A_FACE * len(faces)
    while True:
        if len(faces) > most:
            raise TooComplexError(
                f"What is missing would be made of more than {most} triangles: too many long thin ones cross its "
                "border. Give another plane, or send a mesh whose triangles are less thin."
            )
        some, every, far = _beyond(surface, vertices, faces[new], spacing, tolerance, significant)
        missing, partly, deep = np.append(missing, every), np.append(partly, some & ~every), np.append(deep, far)
        wanted = np.zeros(faces.shape, dtype=np.bool_)
        wanted[partly] = edge_lengths(vertices, faces[partly]) > FINEST_EDGE
        if not wanted.any():
            break
        vertices, faces, parents = halve_edges(vertices, faces, wanted)
        stay = int((np.bincount(parents) == 1).sum())
        missing, partly, deep = missing[parents[:stay]], partly[parents[:stay]], deep[parents[:stay]]
        new = np.arange(stay, len(faces))
    chosen = _significant(faces, missing | partly, deep)
    # With their neighbours, in which the border may run a little beyond the points they were judged by.
    touched = np.zeros(len(vertices), dtype=np.bool_)
    touched[faces[chosen]] = True
    part, part_faces, _ = remove_unreferenced_vertices(vertices, faces[touched[faces].any(axis=1)])
    return _cut(surface, part, part_faces, tolerance)


def _known_first(own: FloatArray, vertices: FloatArray, faces: IntArray) -> tuple[IntArray, int]:
    """The faces, first those whose mirror image is a face itself, and how many these are: nothing need be measured.

    ``own`` and ``vertices`` ``(v, 3)``: of the original and the mirrored surface, of which all have the same ``faces``.
    """
    cells = np.floor(np.concatenate([own, vertices]) / _SAME_PLACE + _SHIFT)
    places = duplicate_vertex_map(cells)
    once = distinct_faces(places[len(own) :], faces)
    known = once & ~distinct_faces(places, np.concatenate([faces, faces + np.int32(len(own))]))[len(faces) :]
    return np.concatenate([faces[known], faces[~known]]), int(known.sum())


def _cut(surface: SurfaceIndex, vertices: FloatArray, faces: IntArray, tolerance: float) -> MissingRegion:
    """The part of the faces that is farther than the tolerance from the surface.

    Whole faces are cut like the others: where they touch the border, their neighbours' cuts go through their edges.
    """

    def crossing(inside: FloatArray, outside: FloatArray) -> FloatArray:
        return _at_distance(surface, inside, outside, tolerance)

    vertices, faces, far = _with_centres(surface, vertices, faces, tolerance)
    clipped = clip(vertices, faces, far, crossing)
    part, part_faces, used = remove_unreferenced_vertices(clipped.vertices, clipped.faces)
    return MissingRegion(part, part_faces, clipped.is_border[used])


def _at_distance(surface: SurfaceIndex, far: FloatArray, near: FloatArray, distance: float) -> FloatArray:
    """Points ``(k, 3)`` between ends that are farther from a surface than a distance and ends that are not.

    They are at that distance, up to ``_CLOSE``. Newton's steps, which mostly end after three (the distance from a plane
    changes evenly), within bounds that at least every other step halves.
    """
    along = near - far
    low, high, at = np.zeros(len(far)), np.ones(len(far)), np.zeros(len(far))
    open_ = np.arange(len(far))
    for step in range(_MOST_STEPS):
        points = far[open_] + at[open_, None] * along[open_]
        closest, squared, _ = surface.closest(points)
        measured = np.sqrt(squared)
        beyond = measured > distance
        low[open_] = np.where(beyond, at[open_], low[open_])
        high[open_] = np.where(beyond, high[open_], at[open_])
        done = np.abs(measured - distance) <= _CLOSE
        done |= (high[open_] - low[open_]) * np.linalg.norm(along[open_], axis=1) <= _CLOSE
        if done.all():
            break
        slope = ((points - closest) * along[open_]).sum(axis=1) / np.maximum(measured, 1e-300)
        guess = at[open_] + (distance - measured) / np.where(slope == 0.0, np.inf, slope)
        middle = (low[open_] + high[open_]) / 2.0
        within = (guess > low[open_]) & (guess < high[open_]) & (step % 4 != 3)
        at[open_] = np.where(done, at[open_], np.where(within, guess, middle))
        open_ = open_[~done]
    return far + at[:, None] * along


def _with_centres(
    surface: SurfaceIndex, vertices: FloatArray, faces: IntArray, tolerance: float
) -> tuple[FloatArray, IntArray, BoolArray]:
    """Faces cut so that each piece that is missing has a corner that is: across a narrow gap they have none.

    Edges of which only the middle is missing are halved, and faces of which only the middle is are cut in three at
    their incentres. Returns vertices, faces, and which vertices are farther away than the tolerance.
    """
    while True:
        far = ~surface.within(vertices, tolerance)
        corners = vertices[faces]
        middles = (corners + np.roll(corners, -1, axis=1)) / 2.0
        wanted = ~far[faces] & ~np.roll(far[faces], -1, axis=1)
        wanted[wanted] = ~surface.within(middles[wanted], tolerance)
        if not wanted.any():
            break
        vertices, faces, _ = halve_edges(vertices, faces, wanted)
    narrow = np.flatnonzero(~far[faces].any(axis=1))
    centres = _incircles(vertices[faces[narrow]])[0]
    beyond = ~surface.within(centres, tolerance)
    narrow, centres = narrow[beyond], centres[beyond]
    a, b, c = faces[narrow].T
    middle = (len(vertices) + np.arange(len(narrow))).astype(np.int32)
    pieces = [np.stack(corners, axis=1) for corners in ((a, b, middle), (b, c, middle), (c, a, middle))]
    others = np.delete(faces, narrow, axis=0)
    far = np.append(far, np.ones(len(narrow), dtype=np.bool_))
    return np.concatenate([vertices, centres]), np.concatenate([others, *pieces]), far


def _incircles(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centres ``(f, 3)`` and radii ``(f,)`` of the inscribed circles of triangles ``(f, 3 corners, 3)``."""
    opposite = np.linalg.norm(np.roll(corners, -1, axis=1) - np.roll(corners, -2, axis=1), axis=2)
    around = np.maximum(opposite.sum(axis=1), 1e-300)
    return (opposite[:, :, None] * corners).sum(axis=1) / around[:, None], 2.0 * triangle_areas(corners) / around


def _beyond(
    surface: SurfaceIndex, vertices: FloatArray, faces: IntArray, spacing: float, tolerance: float, significant: float
) -> tuple[BoolArray, BoolArray, BoolArray]:
    """Of points spread over each triangle, its corners among them, whether some, and all, are beyond the tolerance.

    And whether some are farther than what is ``significant``: ``(f,)`` each. What is nearer to its edges than the
    tolerance is left out: along the border of what is there a triangle that is missing altogether touches it.
    """
    corners, is_thin = _shrunk(vertices[faces], 1.5 * tolerance)
    count = np.ceil(triangle_areas(corners) / spacing**2).astype(np.int64)
    count[edge_lengths(vertices, faces).max(axis=1, initial=0.0) < FINEST_EDGE] = 0
    owner = np.repeat(np.arange(len(faces)), count)
    number = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
    weights = (number[:, None] * _STEP + 0.5) % 1.0
    folded = weights.sum(axis=1) > 1.0
    weights[folded] = 1.0 - weights[folded]
    a, b, c = corners[owner].swapaxes(0, 1) if len(owner) else np.empty((3, 0, 3))
    spread = a + weights[:, :1] * (b - a) + weights[:, 1:] * (c - a)
    # Of thin ones the corners are next to the centre: it stands for them.
    wide = np.flatnonzero(~is_thin)
    points = np.concatenate([corners[wide].reshape(-1, 3), corners.mean(axis=1), spread])
    owners = np.concatenate([np.repeat(wide, 3), np.arange(len(faces)), owner])
    beyond = ~surface.within(points, tolerance)
    some, every, far = (np.zeros(len(faces), dtype=np.bool_) for _ in range(3))
    some[owners[beyond]] = True
    every[:] = True
    every[owners[~beyond]] = False
    deep = owners[beyond][~surface.within(points[beyond], significant)]
    far[deep] = True
    return some, every, far


def _shrunk(corners: FloatArray, margin: float) -> tuple[FloatArray, BoolArray]:
    """Triangles ``(f, 3 corners, 3)`` with their edges moved in by ``margin``, and which are too thin for it."""
    centre, radius = _incircles(corners)
    share = np.minimum(margin / np.maximum(radius, 1e-300), _THIN)
    return corners + share[:, None, None] * (centre[:, None] - corners), share == _THIN


def _significant(faces: IntArray, chosen: BoolArray, deep: BoolArray) -> BoolArray:
    """Of the chosen faces those in a connected part that is ``deep`` somewhere."""
    part = faces[chosen]
    if not len(part):
        return chosen
    labels = np.empty(int(part.max()) + 1, dtype=np.int32)
    connected_parts(kernel_array(part, np.int32), labels)
    owners = labels[part[:, 0]]
    reaches = np.zeros(len(labels), dtype=np.bool_)
    reaches[owners[deep[chosen]]] = True
    result = chosen.copy()
    result[chosen] = reaches[owners]
    return result
