"""Closest-point queries: ours beside libigl and warp (each optional), on one thread.

    OMP_NUM_THREADS=1 python -m benchmarks.closest_point

Queries are surface samples reflected at a plane, as symmetry errors need them.
"""

import importlib.util
import os
from collections.abc import Callable

import numpy as np

from benchmarks.meshes import displaced_sphere, milliseconds, sizes
from model.geometry.sampling import sample_surface
from model.geometry.surface import SurfaceIndex
from model.types import FloatArray, IntArray

_QUERIES = 30_000


def measure_ours(vertices: FloatArray, faces: IntArray, points: FloatArray) -> tuple[float, float, FloatArray]:
    """Milliseconds to build and to query, and the squared distances."""
    repeats = 5 if len(faces) < 500_000 else 2
    build = milliseconds(lambda: SurfaceIndex(vertices, faces), repeats)
    index = SurfaceIndex(vertices, faces)
    query = milliseconds(lambda: index.squared_distances(points), repeats)
    return build, query, index.squared_distances(points)


def measure_libigl(vertices: FloatArray, faces: IntArray, points: FloatArray) -> tuple[float, float, FloatArray]:
    """The same with libigl's AABB tree."""
    import igl

    repeats = 3 if len(faces) < 500_000 else 1
    faces = faces.astype(np.int64)

    def build() -> object:
        tree = igl.AABB()
        tree.init(vertices, faces)
        return tree

    tree = build()
    query = milliseconds(lambda: tree.squared_distance(vertices, faces, points), repeats)
    return milliseconds(build, repeats), query, np.asarray(tree.squared_distance(vertices, faces, points)[0])


def measure_warp(vertices: FloatArray, faces: IntArray, points: FloatArray) -> tuple[float, float, FloatArray]:
    """The same with warp's mesh queries on the CPU; float32."""
    import warp as wp

    from benchmarks.warp_kernel import query_mesh

    wp.config.quiet = True
    wp.init()
    repeats = 3 if len(faces) < 500_000 else 1
    corners = wp.array(vertices.astype(np.float32), dtype=wp.vec3, device="cpu")
    indices = wp.array(faces.reshape(-1), dtype=wp.int32, device="cpu")
    queries = wp.array(points.astype(np.float32), dtype=wp.vec3, device="cpu")
    squared = wp.zeros(len(points), dtype=wp.float32, device="cpu")
    build = milliseconds(lambda: wp.Mesh(corners, indices), repeats)
    mesh = wp.Mesh(corners, indices)
    query = milliseconds(
        lambda: wp.launch(query_mesh, dim=len(points), inputs=[mesh.id, queries, squared], device="cpu"), repeats
    )
    return build, query, squared.numpy().astype(np.float64)


def main() -> None:
    """Print a table, in milliseconds of CPU time: build + queries."""
    rivals: list[tuple[str, Callable[..., tuple[float, float, FloatArray]]]] = [("ours", measure_ours)]
    rivals += [("libigl", measure_libigl)] if importlib.util.find_spec("igl") else []
    rivals += [("warp (CPU)", measure_warp)] if importlib.util.find_spec("warp") else []
    print(f"{_QUERIES} queries, milliseconds of CPU time, OMP_NUM_THREADS={os.environ.get('OMP_NUM_THREADS')}")
    for name, count in sizes().items():
        vertices, faces = displaced_sphere(count)
        points, _ = sample_surface(vertices, faces, _QUERIES, seed=1)
        points = points * [-1, 1, 1]
        reference: FloatArray | None = None
        for rival, measure in rivals:
            build, query, squared = measure(vertices, faces, points)
            reference = squared if reference is None else reference
            worst = np.abs(np.sqrt(squared) - np.sqrt(reference)).max()
            print(f"{name:>5} faces  {rival:<12} build {build:9.2f}   queries {query:9.2f}   differs {worst:.1e}")


if __name__ == "__main__":
    main()
