"""How far the flat faces of a mesh stray from the curved surface that they stand for."""

from functools import cached_property

import numpy as np

from model.geometry.frames import face_normals
from model.geometry.topology import duplicate_vertex_map, edge_neighbours
from model.types import BoolArray, FloatArray, IntArray

_SMOOTH = float(np.cos(np.deg2rad(50.0)))
"""Faces that meet at a smaller angle stand for one curved surface; sharper edges are meant."""

_FLAT = 1.0 - 1e-9


class Facets:
    """The faces ``(f, 3)`` of a mesh with vertices ``(v, 3)``, and the sagitta of each, in the mesh's unit of length.

    The sagitta of a chord is its distance from the middle of its arc. Across a smooth edge with the angle a between its
    faces it is half of a face's width times tan(a / 4).
    """

    def __init__(self, vertices: FloatArray, faces: IntArray) -> None:
        self.vertices, self.faces = vertices, faces

    @cached_property
    def first(self) -> IntArray:
        """For every vertex the first one at its place, ``(v,)``: vertices at one place count as one."""
        return duplicate_vertex_map(self.vertices)

    def at(self, owners: IntArray) -> FloatArray:
        """The largest sagitta on the faces ``(m,)`` or at a corner of theirs: ``(m,)``."""
        of_face, at_vertex = self.sagittas
        return np.maximum(of_face[owners], at_vertex[self.faces[owners]].max(1))

    def is_flat(self, owners: IntArray) -> BoolArray:
        """Which faces ``(m,)`` stand for nothing but themselves, being no facets of a curved surface."""
        return np.asarray(self.sagittas[0][owners] == 0.0)

    @cached_property
    def sagittas(self) -> tuple[FloatArray, FloatArray]:
        """Those of faces ``(f,)``, and at vertices ``(v,)`` the largest of faces and rims that meet there."""
        vertices, faces = self.vertices, self.faces
        first = self.first
        neighbours = edge_neighbours(first, faces)
        normals = face_normals(vertices, faces)
        corners = vertices[faces]
        edges = np.roll(corners, -1, axis=1) - corners
        area = np.sqrt(np.square(np.cross(edges[:, 0], edges[:, 1])).sum(1))
        length = np.sqrt(np.square(edges).sum(2))
        width = np.divide(area[:, None], length, out=np.zeros_like(length), where=length > 0.0)
        cosine = np.einsum("fi,fki->fk", normals, normals[np.maximum(neighbours, 0)])
        smooth = (neighbours >= 0) & (cosine > _SMOOTH) & (cosine < _FLAT)
        angle = np.arccos(np.clip(cosine, -1.0, 1.0))
        # Across each smooth edge the surface bends; where it bends two ways, both add up.
        of_face = np.where(smooth, 0.5 * width * np.tan(angle / 4.0), 0.0).sum(1)
        # A strip between two rulings is as wide as the triangles that share its diagonal.
        flat = (neighbours >= 0) & (cosine >= _FLAT)
        across = np.where(flat, of_face[np.maximum(neighbours, 0)], 0.0).max(1)
        of_face = np.maximum(of_face, across)
        at_vertex = np.zeros(len(vertices))
        for k in range(3):
            np.maximum.at(at_vertex, first[faces[:, k]], of_face)
        sharp = (neighbours < 0) | (cosine <= _SMOOTH)
        _add_rims(vertices, first[faces], sharp, at_vertex)
        return of_face, at_vertex[first]


def _add_rims(vertices: FloatArray, faces: IntArray, sharp: BoolArray, at_vertex: FloatArray) -> None:
    """Raise ``at_vertex`` ``(v,)`` by the sagitta of rims: chains of sharp edges that turn but little at each vertex.

    ``faces`` ``(f, 3)`` with vertices at one place made one; ``sharp`` ``(f, 3)``: of the edges from corner k to the
    next.
    """
    pairs = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2)[sharp]
    pairs = np.unique(np.sort(pairs, axis=1), axis=0)
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    ends, others = pairs.ravel(), pairs[:, ::-1].ravel()
    order = np.argsort(ends, kind="stable")
    ends, others = ends[order], others[order]
    counts = np.bincount(ends, minlength=len(vertices))
    starts = np.cumsum(counts) - counts
    middle = np.flatnonzero(counts == 2)
    before, after = others[starts[middle]], others[starts[middle] + 1]
    arrive, leave = vertices[middle] - vertices[before], vertices[after] - vertices[middle]
    lengths = np.sqrt(np.square(arrive).sum(1)), np.sqrt(np.square(leave).sum(1))
    cosine = np.einsum("ij,ij->i", arrive, leave) / np.maximum(lengths[0] * lengths[1], 1e-300)
    turn = np.arccos(np.clip(cosine, -1.0, 1.0))
    sagitta = np.where(cosine > _SMOOTH, 0.5 * np.maximum(*lengths) * np.tan(turn / 4.0), 0.0)
    for vertex in (middle, before, after):
        np.maximum.at(at_vertex, vertex, sagitta)
