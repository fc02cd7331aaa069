"""Cutting triangles smaller without opening gaps."""

import numpy as np

from model.types import BoolArray, FloatArray, IntArray


def edge_lengths(vertices: FloatArray, faces: IntArray) -> FloatArray:
    """``(f, 3)`` lengths of the edges from corner 0 to 1, 1 to 2 and 2 to 0."""
    corners = vertices[faces]
    along = corners - corners[:, [1, 2, 0]]
    return np.sqrt(np.einsum("fij,fij->fi", along, along))


def subdivide(vertices: FloatArray, faces: IntArray, longest: float) -> tuple[FloatArray, IntArray]:
    """Halve all edges longer than ``longest``, in both triangles alike, until there is none."""
    while True:
        wanted = edge_lengths(vertices, faces) > longest
        if not wanted.any():
            return vertices, faces
        vertices, faces, _ = halve_edges(vertices, faces, wanted)


def halve_edges(vertices: FloatArray, faces: IntArray, wanted: BoolArray) -> tuple[FloatArray, IntArray, IntArray]:
    """Halve the edges marked in ``wanted`` ``(f, 3)``, in every triangle that has them: no gaps open.

    Returns:
        the vertices with the new ones behind them, the faces ``(g, 3)``, those that stay first and in their order, and
        for each the face it was or is a part of ``(g,)``.
    """
    following = np.roll(faces, -1, axis=1)
    keys = np.minimum(faces, following).astype(np.int64) * len(vertices) + np.maximum(faces, following)
    marked = np.unique(keys[wanted])
    ends = np.stack([marked // len(vertices), marked % len(vertices)], axis=1)
    position = np.minimum(np.searchsorted(marked, keys), len(marked) - 1)
    middle = np.where(marked[position] == keys, len(vertices) + position, -1)
    grown = np.concatenate([vertices, vertices[ends].mean(1)])
    count = (middle >= 0).sum(1)
    parts, parents = [faces[count == 0]], [np.flatnonzero(count == 0)]
    for halved, lead in ((1, middle >= 0), (2, middle < 0), (3, middle >= -1)):
        chosen = count == halved
        # Turn the corners: one halved edge comes first, one that is not comes last.
        first = np.argmax(lead[chosen], axis=1) + (1 if halved == 2 else 0)
        turn = (first[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(faces[chosen], turn, axis=1).T
        m, n, o = np.take_along_axis(middle[chosen], turn, axis=1).T
        triangles = {
            1: [(a, m, c), (m, b, c)],
            2: [(m, b, n), (a, m, n), (a, n, c)],
            3: [(a, m, o), (m, b, n), (o, n, c), (m, n, o)],
        }[halved]
        parts += [np.stack(triangle, axis=1) for triangle in triangles]
        parents += [np.flatnonzero(chosen)] * len(triangles)
    faces = np.ascontiguousarray(np.concatenate(parts), dtype=np.int32)
    return grown, faces, np.concatenate(parents).astype(np.int32)
