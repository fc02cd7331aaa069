"""Deviations of features of a mesh, and what the facets at either end leave open: see `model.search.exactness`.

Everything is in the axes of the tree.
"""

import numpy as np

from model._jit import jit, jit_allocating
from model.geometry._bvh import LANES, Tree, scratch
from model.geometry._bvh_frames import closest_on
from model.geometry._bvh_query import nearest
from model.geometry._operation_kernels import image_of
from model.types import FloatArray, IntArray

_AT_END = 1e-6


@jit_allocating
def feature_deviations(
    begin: int,
    points: FloatArray,
    sagittas: FloatArray,
    fixed: FloatArray,
    linear: FloatArray,
    slack: float,
    base: float,
    on_edge: float,
    first: IntArray,
    of_face: FloatArray,
    at_vertex: FloatArray,
    tree: Tree,
    deviations: FloatArray,
    allowed: FloatArray,
    coinciding: IntArray,
) -> int:
    """Fill ``deviations`` and ``allowed`` ``(m,)`` for the images ``R (p - f) + f`` of points ``(m, 3)``.

    What deviates by no more than ``base`` is allowed just that. ``coinciding`` ``(m,)``: the vertex that an image
    coincides with to ``base``, the ``first`` at its place, or -1.

    Returns:
        where it ended: before the first point that facets may allow more, if ``at_vertex`` is empty, else ``m``. From
        there it may go on (``begin``).
    """
    paper = scratch()
    image, place = np.empty(3), np.empty(3)
    seed = 0
    for i in range(begin, len(points)):
        image_of(points[i], fixed, linear, image)
        squared, lane = nearest(
            image[0],
            image[1],
            image[2],
            seed,
            np.inf,
            tree,
            paper,
        )
        seed = lane // LANES
        owner = tree.owners[lane]
        deviations[i], allowed[i] = np.sqrt(squared), base
        if deviations[i] > base:  # else it may, whatever facets leave open
            if not len(at_vertex):
                return i
            place[0], place[1], place[2] = closest_on(image[0], image[1], image[2], lane, tree)
            rim = _rim(place, tree.vertices, tree.faces[owner], at_vertex, on_edge)
            allowed[i] = base + slack * max(sagittas[i], of_face[owner], rim)
        coinciding[i] = -1
        for k in range(3):
            gap = 0.0
            for a in range(3):
                gap += (image[a] - tree.vertices[tree.faces[owner, k], a]) ** 2
            if gap <= base * base:
                coinciding[i] = first[tree.faces[owner, k]]
    return len(points)


@jit
def _rim(place: FloatArray, vertices: FloatArray, face: IntArray, at_vertex: FloatArray, near: float) -> float:
    """The sagitta of the rim that a point of a face lies on: of an edge the smaller one of its ends; 0 off all edges.

    A flat face beside a rounded rim is cut along chords: there the rim's sagitta counts.
    """
    result = 0.0
    for k in range(3):
        here, other = face[k], face[(k + 1) % 3]
        if max(at_vertex[here], at_vertex[other]) <= result:
            continue
        dot, square = 0.0, 0.0
        for a in range(3):
            along = vertices[other, a] - vertices[here, a]
            dot += along * (place[a] - vertices[here, a])
            square += along * along
        share = dot / max(square, 1e-300)
        clipped, gap = min(max(share, 0.0), 1.0), 0.0
        for a in range(3):
            off = place[a] - vertices[here, a] - clipped * (vertices[other, a] - vertices[here, a])
            gap += off * off
        if gap < near:
            if share < _AT_END:
                sagitta = float(at_vertex[here])
            elif share > 1.0 - _AT_END:
                sagitta = float(at_vertex[other])
            else:
                sagitta = min(float(at_vertex[here]), float(at_vertex[other]))
            result = max(result, sagitta)
    return result
