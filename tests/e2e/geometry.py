"""Exact distances by brute force, independent of the package under test; and meshes as files."""

from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from trimesh.exchange.gltf import export_gltf

Array = NDArray[np.float64]


def surface_samples(mesh: trimesh.Trimesh, count: int) -> Array:
    """(count, 3) points spread over the surface by area."""
    points, _ = trimesh.sample.sample_surface(mesh, count, seed=7)
    return np.asarray(points)


def squared_distances(mesh: trimesh.Trimesh, points: Array) -> Array:
    """(n,) squared distance of each point to the nearest triangle."""
    triangles = np.asarray(mesh.triangles)
    nearest = np.empty(len(points))
    for i, point in enumerate(points):
        repeated = np.broadcast_to(point, (len(triangles), 3))
        closest = trimesh.triangles.closest_point(triangles, repeated)
        nearest[i] = ((closest - point) ** 2).sum(axis=1).min()
    return nearest


def symmetry_error(mesh: trimesh.Trimesh, matrix: Any, scale: float, count: int = 400) -> float:
    """Mean squared distance of the moved surface to the surface, in the unit frame."""
    matrix = np.asarray(matrix, dtype=float)
    points = surface_samples(mesh, count)
    moved = points @ matrix[:3, :3].T + matrix[:3, 3]
    return float(squared_distances(mesh, moved).mean() / scale**2)


def angle_degrees(a: Any, b: Any) -> float:
    """Angle between two directions whose signs do not matter."""
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    return float(np.degrees(np.arccos(min(1.0, abs(a @ b) / np.linalg.norm(a) / np.linalg.norm(b)))))


def embedded_gltf(scene: trimesh.Scene) -> bytes:
    """The scene as one .gltf file without external buffers."""
    return export_gltf(scene, merge_buffers=True, embed_buffers=True)["model.gltf"]


def as_file(mesh: trimesh.Trimesh, extension: str) -> bytes:
    """The mesh in one of the supported formats."""
    if extension == "gltf":
        return embedded_gltf(trimesh.Scene(mesh))
    content = mesh.export(file_type=extension)
    return content.encode() if isinstance(content, str) else content
