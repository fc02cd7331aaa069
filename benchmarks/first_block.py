"""The sparse first block beside the dense convolution and pooling it equals: `python -m benchmarks.first_block`.

Forward and backward of the whole feature extractor on a batch of 32 turned ellipsoid shells, one thread; medians of
CPU milliseconds, the two taken in turn.
"""

import time
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from model.network.architecture import Architecture
from model.network.network import PRSNet

BATCH, ROUNDS = 32, 9


def shells() -> Tensor:
    """Voxels ``(32, 1, 32, 32, 32)`` of ellipsoid shells of different proportions, filling two or three per cent."""
    rng = np.random.default_rng(0)
    grid = np.indices((32, 32, 32)) - 15.5
    radii = [np.sqrt(np.square(grid * rng.uniform(0.7, 3.0, (3, 1, 1, 1))).sum(0)) for _ in range(BATCH)]
    return torch.from_numpy(np.stack([np.abs(radius - 11.0) < 1.0 for radius in radii]))[:, None].float()


def cost(features: Callable[[Tensor], Tensor], voxels: Tensor) -> float:
    """CPU milliseconds of one forward and backward pass."""
    began = time.process_time()
    features(voxels).sum().backward()
    return (time.process_time() - began) * 1e3


def main() -> None:
    """Print a line a width."""
    torch.set_num_threads(1)
    voxels = shells()
    print(f"occupied {voxels.mean():.1%}")
    for width in (1, 2):
        network = PRSNet(Architecture(width=width, batch_norm=width > 1)).to(memory_format=torch.channels_last_3d)
        dense_input = voxels.contiguous(memory_format=torch.channels_last_3d)
        pairs = [(cost(network._features, voxels), cost(network.features, dense_input)) for _ in range(ROUNDS + 1)][1:]
        sparse, dense = np.median(pairs, axis=0)
        ratio = np.median([b / a for a, b in pairs])
        print(f"width {width}: sparse {sparse:.0f} ms, dense {dense:.0f} ms, ratio {ratio:.2f}")


if __name__ == "__main__":
    main()
