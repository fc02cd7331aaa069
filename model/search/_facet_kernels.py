"""Sagittas of facets: see `model.search.facets`."""

import numpy as np

from model._jit import jit, jit_inlined
from model.types import BoolArray, FloatArray, IntArray


@jit
def bends(
    vertices: FloatArray,
    faces: IntArray,
    normals: FloatArray,
    neighbours: IntArray,
    smooth: float,
    flat: float,
    sagittas: FloatArray,
    sharp: BoolArray,
) -> None:
    """Fill ``sagittas`` ``(f,)``, those across each face's own smooth edges added up, and ``sharp`` ``(f, 3)``.

    An edge is smooth if the cosine between its faces lies between ``smooth`` and ``flat``, and sharp below or where no
    face is beyond.
    """
    for face in range(faces.shape[0]):
        i, j, k = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, ay, az = vertices[j, 0] - vertices[i, 0], vertices[j, 1] - vertices[i, 1], vertices[j, 2] - vertices[i, 2]
        bx, by, bz = vertices[k, 0] - vertices[j, 0], vertices[k, 1] - vertices[j, 1], vertices[k, 2] - vertices[j, 2]
        cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        area = np.sqrt(cx * cx + cy * cy + cz * cz)
        total = 0.0
        for edge in range(3):
            other = neighbours[face, edge]
            if other < 0:
                sharp[face, edge] = True
                continue
            cosine = 0.0
            for axis in range(3):
                cosine += normals[face, axis] * normals[other, axis]
            sharp[face, edge] = cosine <= smooth
            if cosine <= smooth or cosine >= flat:
                continue
            start, end = faces[face, edge], faces[face, (edge + 1) % 3]
            length = 0.0
            for axis in range(3):
                length += (vertices[end, axis] - vertices[start, axis]) ** 2
            if length > 0.0:
                total += 0.5 * area / np.sqrt(length) * _tangent_of_quarter(cosine)
        sagittas[face] = total


@jit_inlined
def _tangent_of_quarter(cosine: float) -> float:
    """Of a quarter of the angle with this cosine, which is at most 1 and more than -1."""
    return np.sqrt(0.5 - 0.5 * cosine) / (1.0 + np.sqrt(0.5 + 0.5 * cosine))


@jit
def raise_to_flat_neighbours(
    normals: FloatArray, neighbours: IntArray, flat: float, own: FloatArray, of_face: FloatArray
) -> None:
    """Fill ``of_face`` ``(f,)`` with the largest of a face and those that lie flat beside it.

    A strip between two rulings is as wide as the triangles that share its diagonal.
    """
    for face in range(neighbours.shape[0]):
        largest = own[face]
        for edge in range(3):
            other = neighbours[face, edge]
            if other >= 0 and own[other] > largest:
                cosine = 0.0
                for axis in range(3):
                    cosine += normals[face, axis] * normals[other, axis]
                if cosine >= flat:
                    largest = own[other]
        of_face[face] = largest


@jit
def raise_corners(faces: IntArray, first: IntArray, of_face: FloatArray, at_vertex: FloatArray) -> None:
    """Raise ``at_vertex`` ``(v,)`` to the largest of the faces that meet there."""
    for face in range(faces.shape[0]):
        for corner in range(3):
            vertex = first[faces[face, corner]]
            at_vertex[vertex] = max(at_vertex[vertex], of_face[face])


@jit
def add_rims(
    vertices: FloatArray,
    faces: IntArray,
    first: IntArray,
    sharp: BoolArray,
    smooth: float,
    beside: IntArray,
    around: IntArray,
    at_vertex: FloatArray,
) -> None:
    """Raise ``at_vertex`` ``(v,)`` by the sagitta of rims: chains of sharp edges that turn but little at each vertex.

    ``sharp`` ``(f, 3)``: of the edges from corner k to the next. ``beside`` ``(v, 2)`` is scratch, and so is ``around``
    ``(v,)``, all 0: how many sharp edges meet at a vertex, and where the first two lead.
    """
    for face in range(faces.shape[0]):
        for edge in range(3):
            one, other = int(first[faces[face, edge]]), int(first[faces[face, (edge + 1) % 3]])
            if sharp[face, edge] and one != other:
                _meet(one, other, beside, around)
                _meet(other, one, beside, around)
    for vertex in range(around.shape[0]):
        if around[vertex] != 2:
            continue
        before, after = beside[vertex, 0], beside[vertex, 1]
        dot, arrive, leave = 0.0, 0.0, 0.0
        for axis in range(3):
            a, b = vertices[vertex, axis] - vertices[before, axis], vertices[after, axis] - vertices[vertex, axis]
            dot, arrive, leave = dot + a * b, arrive + a * a, leave + b * b
        arrive, leave = np.sqrt(arrive), np.sqrt(leave)
        cosine = dot / max(arrive * leave, 1e-300)
        if cosine > smooth:
            sagitta = 0.5 * max(arrive, leave) * _tangent_of_quarter(min(cosine, 1.0))
            at_vertex[vertex] = max(at_vertex[vertex], sagitta)
            at_vertex[before] = max(at_vertex[before], sagitta)
            at_vertex[after] = max(at_vertex[after], sagitta)


@jit
def _meet(here: int, there: int, beside: IntArray, around: IntArray) -> None:
    """Note a sharp edge from one vertex to another, if it is not known from its other face."""
    count = around[here]
    if (count > 0 and beside[here, 0] == there) or (count > 1 and beside[here, 1] == there):
        return
    if count < 2:
        beside[here, count] = there
    around[here] = count + 1
