"""A network with layers that `model.network.inference` does not know, computed by its own ``forward`` in torch."""

import numpy as np
import torch
from torch import Tensor

from model.network.network import PRSNet
from model.types import AnyArray, BoolArray


class ForwardNetwork:
    """Answers as `model.network.inference.CpuNetwork` does, at its own speed."""

    def __init__(self, network: PRSNet) -> None:
        self._network = network.eval()

    def __call__(self, *views: tuple[BoolArray, BoolArray]) -> tuple[AnyArray, AnyArray]:
        """Planes ``(F, p, 4)`` and quaternions ``(F, r, 4)`` of the frames of several views."""
        grids: list[AnyArray] = [
            occupied[::x, ::y, ::z] for occupied, flips in views for x, y, z in np.where(flips, -1, 1).tolist()
        ]
        voxels: Tensor = torch.from_numpy(np.stack(grids).astype(np.float32))  # pyright: ignore[reportUnknownMemberType]
        with torch.inference_mode():
            planes, quaternions = self._network(voxels[:, None])
        return planes.numpy(), quaternions.numpy()
