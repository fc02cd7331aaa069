"""How long the network takes on one core: `python benchmarks/network.py [WEIGHTS...]`.

CPU milliseconds of `model.network.inference.CpuNetwork` on the voxels of the meshes of tests/data, for
1, 2, 4 and 8 sign frames in one batch, beside `PRSNet.forward` on the same batch; and of the frames of paper mode,
alone and with the choice among their answers. Medians; run it on an idle machine.
"""

import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import torch

from model.detector import use_one_thread
from model.formats import read_mesh
from model.geometry.frames import UnitFrame, inertia_frame
from model.network.checkpoint import Checkpoint, load_checkpoint
from model.network.proposals import rotated_voxels
from model.network.views import look, other_views
from model.types import FloatArray, IntArray

MESHES = Path(__file__).parents[1] / "tests/data"
RUNS = 25
FLIPS = np.array(list(product((False, True), repeat=3)))


def median_ms(run: Callable[[], object]) -> float:
    """Median CPU time of a call in this thread."""
    run()
    spent: list[float] = []
    for _ in range(RUNS):
        began = time.thread_time()
        run()
        spent.append(time.thread_time() - began)
    return 1e3 * float(np.median(spent))


def main(weights: list[str]) -> None:
    """One table."""
    use_one_thread()
    shapes = list(_shapes())
    print("| weights | frames | compiled, ms | PRSNet.forward, ms |\n| --- | --- | --- | --- |")
    for name in weights:
        checkpoint = load_checkpoint(name)
        for frames in (1, 2, 4, 8):
            compiled, plain = [], []
            for vertices, faces, principal in shapes:
                grid = rotated_voxels(checkpoint, vertices, faces, principal)
                flips = FLIPS[:frames]
                batch = np.stack([np.flip(grid, [axis for axis in range(3) if flip[axis]]) for flip in flips])
                voxels = torch.as_tensor(batch[:, None].astype(np.float32))
                compiled.append(median_ms(partial(checkpoint.compiled, (grid, flips))))
                with torch.inference_mode():
                    plain.append(median_ms(partial(checkpoint.network, voxels)))
            print(f"| {name} | {frames} | {np.median(compiled):.2f} | {np.median(plain):.2f} |", flush=True)
        used = np.median([_as_used(checkpoint, *shape) for shape in shapes], axis=0)
        frames = checkpoint.input.sign_frames * checkpoint.input.views
        print(f"| {name} | the {frames} of paper mode | {used[0]:.2f} | |", flush=True)
        print(f"| {name} | the same, with what follows | {used[1]:.2f} | |", flush=True)


def _shapes() -> Iterator[tuple[FloatArray, IntArray, FloatArray]]:
    """Vertices in the unit frame, faces and inertia frame of the meshes of tests/data."""
    for path in sorted(MESHES.iterdir()):
        if path.suffix != ".md":
            mesh = read_mesh(path.read_bytes(), path.name)
            vertices = UnitFrame.of(mesh.vertices, mesh.faces).to_unit(mesh.vertices)
            yield vertices, mesh.faces, inertia_frame(vertices, mesh.faces)[0]


def _as_used(
    checkpoint: Checkpoint, vertices: FloatArray, faces: IntArray, principal: FloatArray
) -> tuple[float, float]:
    """Milliseconds of one pass over all its frames, and with means and the choice among all answers; voxels given."""
    rotations = [principal, *other_views(principal)][: checkpoint.input.views]
    grids = [rotated_voxels(checkpoint, vertices, faces, rotation) for rotation in rotations]
    flips = FLIPS[: checkpoint.input.sign_frames]
    forward = partial(checkpoint.compiled, *((grid, flips) for grid in grids))
    return median_ms(forward), median_ms(partial(look, checkpoint, grids, rotations))


if __name__ == "__main__":
    main(sys.argv[1:] or ["default", "paper"])
