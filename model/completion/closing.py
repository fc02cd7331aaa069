"""Cuts that are closed: of all bodies together, or of each alone where they overlap."""

from dataclasses import dataclass

import numpy as np

from model.completion.half_space import capped_half_space
from model.completion.lids import counted_edges, view_from_below
from model.completion.outlines import overlapping_outlines
from model.errors import DegenerateMeshError
from model.geometry.topology import connected_parts
from model.meshes.bodies import surrounds
from model.meshes.clipping import remove_unreferenced_vertices
from model.types import AnyArray, BoolArray, FloatArray, IntArray

_MOST_BODIES = 100
"""That are cut: of more it is not asked whether they overlap."""

_MOST_CUT_FACES = 20_000
"""Of bodies that may overlap: the time to close each of them may grow with the square."""

_MOST_FACES_ASKED = 1_000_000
"""Of bodies that others may lie in."""


@dataclass(frozen=True, slots=True, eq=False)
class ClosedPart:
    """Vertices ``(v, 3)``, faces ``(f, 3)``, and how many bodies overlap in a cut, each of which is closed alone."""

    vertices: FloatArray
    faces: IntArray
    overlapping: int = 0


def closed_part(vertices: FloatArray, faces: IntArray, cuts: FloatArray, rounding: float) -> ClosedPart | None:
    """What is on the positive side of all planes, with lids on the cuts; None where nobody knows what is inside.

    A body that lies wholly inside another one is a hollow of it. Bodies that overlap otherwise are closed each alone:
    they overlap in the result as they did before.

    Args:
        vertices: ``(v, 3)``, each place once.
        faces: ``(f, 3)``.
        cuts: ``(c, 4)`` planes ``(n, d)`` with unit normals.
        rounding: how far from a plane a vertex is that is on it.

    Raises:
        DegenerateMeshError: nothing of the mesh is there.
    """
    together = _cut(vertices, faces, cuts, rounding)
    groups = _groups(vertices, faces, cuts)
    if not groups:
        return None if together is None else ClosedPart(*together)
    parts: list[tuple[FloatArray, IntArray]] = []
    for group in groups:
        try:
            own, own_faces, _ = remove_unreferenced_vertices(vertices, faces[group])
            part = _cut(own, own_faces, cuts, rounding)
        except DegenerateMeshError:
            continue
        if part is None:
            return None if together is None else ClosedPart(*together)
        parts.append(part)
    overlapping = overlapping_outlines([[_outline(*part, cut, rounding) for part in parts] for cut in cuts])
    if not overlapping and together is not None:
        return ClosedPart(*together)
    starts = np.cumsum([0, *(len(part) for part, _ in parts)])
    joined = [part + np.int32(start) for (_, part), start in zip(parts, starts[:-1], strict=True)]
    return ClosedPart(np.concatenate([part for part, _ in parts]), np.concatenate(joined), len(overlapping))


def _cut(
    vertices: FloatArray, faces: IntArray, cuts: FloatArray, rounding: float
) -> tuple[FloatArray, IntArray] | None:
    """One cut and closed after the other."""
    result: tuple[FloatArray, IntArray] | None = vertices, faces
    for plane in cuts:
        result = None if result is None else capped_half_space(*result, plane, rounding)
    return result


def _outline(vertices: FloatArray, faces: IntArray, cut: FloatArray, rounding: float) -> FloatArray:
    """Edges ``(e, 2, 2)`` around the lid in a cut, as seen along it."""
    lying = (np.abs(vertices @ cut[:3] + cut[3]) <= 4.0 * rounding)[faces].all(axis=1)
    edges, counts = counted_edges(faces[lying])
    flat = vertices @ view_from_below(cut[:3])
    return flat[edges[counts == 1]].reshape(-1, 2, 2)


def _groups(vertices: FloatArray, faces: IntArray, cuts: FloatArray) -> list[BoolArray]:
    """Faces ``(f,)`` of bodies that are closed together.

    Empty where no two bodies that are cut can overlap, or there are too many to tell.
    """
    parts = np.empty(len(vertices), dtype=np.int32)
    connected_parts(faces, parts)
    of_face = parts[faces[:, 0]]
    heights = vertices @ cuts[:, :3].T + cuts[:, 3]
    low, high = heights[faces].min(axis=1), heights[faces].max(axis=1)
    crossed = ((low < 0.0) & (high > 0.0)).any(axis=1)
    bodies = np.unique(of_face[crossed])
    if not 1 < len(bodies) <= _MOST_BODIES or crossed.sum() > _MOST_CUT_FACES:
        return []
    shells: list[IntArray] = [faces[of_face == body] for body in bodies.tolist()]
    boxes = np.array([[vertices[shell].min(axis=(0, 1)), vertices[shell].max(axis=(0, 1))] for shell in shells])
    near = np.asarray(((boxes[:, None, 0] <= boxes[:, 1]) & (boxes[:, 0] <= boxes[:, None, 1])).all(axis=2))
    np.fill_diagonal(near, False)
    if not near.any():
        return []
    host = _hosts(vertices, shells, boxes)
    if host is None:
        return []
    number = np.full(len(vertices), -1, dtype=np.int64)
    number[bodies] = host
    group_of_face = number[of_face]
    rest: BoolArray = group_of_face < 0
    groups = [np.asarray(group_of_face == group) for group in np.unique(host).tolist()]
    return [*groups, rest] if rest.any() else groups


def _hosts(vertices: FloatArray, shells: list[IntArray], boxes: AnyArray) -> AnyArray | None:
    """Of every body the largest one that it lies wholly inside of, or itself: ``(b,)``; None if that is too much."""
    extents = np.prod(boxes[:, 1] - boxes[:, 0], axis=1)
    order: list[int] = np.argsort(-extents, kind="stable").tolist()
    host: AnyArray = np.arange(len(shells))
    left = _MOST_FACES_ASKED
    for place, inner in enumerate(order):
        for outer in order[:place]:
            within = (boxes[outer, 0] < boxes[inner, 0]).all() and (boxes[outer, 1] > boxes[inner, 1]).all()
            if host[outer] != outer or not within:
                continue
            left -= len(shells[outer])
            if left < 0:
                return None
            if surrounds(vertices, shells[outer], shells[inner]):
                host[inner] = outer
                break
    return host
