"""How far the flat faces of a mesh stray from the curved surface that they stand for."""

from functools import cached_property

import numpy as np

from model._jit import kernel_array
from model.geometry.edges import EdgeTable
from model.geometry.normals import face_normals
from model.geometry.topology import duplicate_vertex_map
from model.search._facet_kernels import add_rims, bends, raise_corners, raise_to_flat_neighbours
from model.types import BoolArray, FloatArray, IntArray

_SMOOTH = float(np.cos(np.deg2rad(50.0)))
"""Faces that meet at a smaller angle stand for one curved surface; sharper edges are meant."""

_FLAT = 1.0 - 1e-9
_FEW = 20_000
"""Up to so many faces all sagittas cost no more than those of a few hundred by themselves."""


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

    @cached_property
    def edges(self) -> EdgeTable:
        """All edges, vertices at one place counting as one."""
        return EdgeTable(self.first, self.faces)

    def at(self, owners: IntArray) -> FloatArray:
        """The largest sagitta on the faces ``(m,)`` or at a corner of theirs: ``(m,)``."""
        of_face, at_vertex = self.sagittas
        return np.maximum(of_face[owners], at_vertex[self.faces[owners]].max(1))

    def is_flat(self, owners: IntArray) -> BoolArray:
        """Which faces ``(m,)`` stand for nothing but themselves, being no facets of a curved surface."""
        if len(self.faces) <= _FEW or self.are_sagittas_known:
            return np.asarray(self.sagittas[0][owners] == 0.0)
        return np.asarray(self.sagittas_of(owners) == 0.0)

    def sagittas_of(self, owners: IntArray) -> FloatArray:
        """Those of some faces ``(m,)``, from these and what is around them alone."""
        edges = self.edges
        some = np.unique(owners)
        beside = np.unique(np.append(edges.neighbours_of(some), some))
        beside = beside[beside >= 0].astype(np.int32)
        neighbours = edges.neighbours_of(beside)
        around = np.unique(np.append(neighbours, beside))
        around = around[around >= 0].astype(np.int32)
        known = np.full((len(around), 3), -1, dtype=np.int32)
        known[np.searchsorted(around, beside)] = np.where(neighbours < 0, -1, np.searchsorted(around, neighbours))
        vertices, faces = kernel_array(self.vertices, np.float64), kernel_array(self.faces[around], np.int32)
        normals, own, of_face = face_normals(vertices, faces), np.empty(len(faces)), np.empty(len(faces))
        bends(vertices, faces, normals, known, _SMOOTH, _FLAT, own, np.empty(faces.shape, dtype=np.bool_))
        raise_to_flat_neighbours(normals, known, _FLAT, own, of_face)
        return of_face[np.searchsorted(around, owners)]

    @property
    def are_sagittas_known(self) -> bool:
        """Whether ``sagittas`` are at hand, for which all faces have to be looked at."""
        return "sagittas" in self.__dict__

    @cached_property
    def sagittas(self) -> tuple[FloatArray, FloatArray]:
        """Those of faces ``(f,)``, and at vertices ``(v,)`` the largest of faces and rims that meet there."""
        vertices, faces = kernel_array(self.vertices, np.float64), kernel_array(self.faces, np.int32)
        first = kernel_array(self.first, np.int32)
        neighbours = self.edges.neighbours
        normals = face_normals(vertices, faces)
        own, of_face, at_vertex = np.empty(len(faces)), np.empty(len(faces)), np.zeros(len(vertices))
        sharp = np.empty(faces.shape, dtype=np.bool_)
        bends(vertices, faces, normals, neighbours, _SMOOTH, _FLAT, own, sharp)
        raise_to_flat_neighbours(normals, neighbours, _FLAT, own, of_face)
        raise_corners(faces, first, of_face, at_vertex)
        beside, around = np.empty((len(vertices), 2), dtype=np.int32), np.zeros(len(vertices), dtype=np.int32)
        add_rims(vertices, faces, first, sharp, _SMOOTH, beside, around, at_vertex)
        return of_face, at_vertex[first]
