"""Exact surface voxelization at 32^3 and surface sampling: ours beside trimesh's voxelizer (small meshes only).

    OMP_NUM_THREADS=1 python -m benchmarks.voxelize

libigl and warp have no exact surface voxelizer to compare with.
"""

import importlib.util

import numpy as np

from benchmarks.meshes import displaced_sphere, milliseconds, sizes
from model.geometry.sampling import sample_surface
from model.geometry.voxels import voxelize


def main() -> None:
    """Print a table, in milliseconds of CPU time."""
    for name, count in sizes().items():
        vertices, faces = displaced_sphere(count)
        exact = milliseconds(lambda v=vertices, f=faces: voxelize(v, f), 10)
        sample = milliseconds(lambda v=vertices, f=faces: sample_surface(v, f, 10_000, 1), 10)
        grid = voxelize(vertices, faces)
        points, _ = sample_surface(vertices, faces, 100_000, 1)
        sampled = np.zeros_like(grid)
        sampled[tuple(np.floor((points + 0.5) * 32).astype(int).T)] = True
        missed = 1 - (sampled & grid).sum() / grid.sum()
        line = f"{name:>5} faces  voxelize {exact:8.2f}   10k samples {sample:7.2f}"
        line += f"   missed by 100k samples {missed:5.1%}"
        if count < 10_000 and importlib.util.find_spec("trimesh"):
            import trimesh

            mesh = trimesh.Trimesh(vertices, faces, process=False)
            line += f"   trimesh's voxelizer {milliseconds(lambda m=mesh: m.voxelized(1 / 32), 1):8.2f}"
        print(line)


if __name__ == "__main__":
    main()
