"""Meshes with known symmetry for the tests, as `Mesh` and in any pose."""

from dataclasses import replace

import numpy as np

from model.meshes.mesh import Mesh
from model.types import FloatArray
from training.shapes.catalogue import KnownShape, generate
from training.shapes.solids import random_rotation


def known(family: str, seed: int = 0, **parameters: object) -> KnownShape:
    """A procedural shape in its own frame."""
    return generate(family, np.random.default_rng(seed), **parameters)


def as_mesh(shape: KnownShape) -> Mesh:
    return Mesh.checked(shape.vertices, shape.faces)


def box(x: float = 1.0, y: float = 2.0, z: float = 3.0) -> Mesh:
    """An axis-aligned box about the origin; its three planes are the coordinate planes."""
    corners = np.array([[i, j, k] for i in (-x / 2, x / 2) for j in (-y / 2, y / 2) for k in (-z / 2, z / 2)])
    quads = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
    faces = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], dtype=np.int32)
    return Mesh.checked(corners, faces)


def moved(mesh: Mesh, rotation: FloatArray, translation: FloatArray, scale: float) -> Mesh:
    return replace(mesh, vertices=np.ascontiguousarray(scale * mesh.vertices @ rotation.T + translation))


def subdivided(mesh: Mesh) -> Mesh:
    """Every triangle cut into four: another tessellation of the same surface."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    pieces = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    corners = np.concatenate([np.stack(piece, axis=1) for piece in pieces]).reshape(-1, 3)
    return Mesh.checked(corners, np.arange(len(corners), dtype=np.int32).reshape(-1, 3))


def pose(seed: int) -> tuple[FloatArray, FloatArray, float]:
    """A rotation, a translation and a scale."""
    rng = np.random.default_rng(seed)
    return random_rotation(rng), rng.normal(0.0, 50.0, 3), float(np.exp(rng.normal(0.0, 2.0)))
