"""PRS-Net, the network of the paper (section 3): voxels in, planes and rotations out. Torch only."""

from typing import cast

import torch
from torch import Tensor, nn

from model.network.architecture import HEAD_OUTPUTS, LEAKY_SLOPE, Architecture
from model.network.sparse_block import convolve, convolve_and_pool


class PRSNet(nn.Module):
    """The paper's network: log2 R blocks of convolution, max pooling and leaky ReLU, then one small head an output.

    The feature vector has as many entries as the last block has channels (64 in the paper). Every head is fully
    connected, ``features -> features / 2 -> features / 4 -> 4``, the last layer linear.
    """

    def __init__(self, architecture: Architecture | None = None) -> None:
        super().__init__()
        self.architecture = architecture or Architecture()
        layers: list[nn.Module] = []
        channels_in = 1
        for channels in self.architecture.block_channels:
            layers += [nn.Conv3d(channels_in, channels, kernel_size=3, padding=1), nn.MaxPool3d(2)]
            if self.architecture.batch_norm:
                layers.append(nn.BatchNorm3d(channels))
            layers.append(nn.LeakyReLU(LEAKY_SLOPE, inplace=True))
            channels_in = channels
        self.features = nn.Sequential(*layers)
        self.plane_heads = nn.ModuleList(_head(channels_in) for _ in range(self.architecture.planes))
        self.rotation_heads = nn.ModuleList(_head(channels_in) for _ in range(self.architecture.rotations))
        self._initialise()

    def _initialise(self) -> None:
        """Section 3: perpendicular planes and axes, half turns; convolutions drawn from N(0, 0.02).

        With batch normalisation the scale of a convolution does not matter. The plane heads' last weights are
        zero, so that every input starts at exactly the coordinate planes; the rotation heads keep the default
        initialisation of their weights around the bias of a half turn.
        """
        for module in self.features:
            if isinstance(module, nn.Conv3d):
                nn.init.normal_(module.weight, 0.0, 0.02)
        directions = torch.eye(3)
        for direction, head in zip(directions, self.plane_heads, strict=False):
            last = _last_layer(head)
            nn.init.zeros_(last.weight)
            _set_bias(last, torch.cat([direction, torch.zeros(1)]))
        for direction, head in zip(directions, self.rotation_heads, strict=False):
            _set_bias(_last_layer(head), torch.cat([torch.zeros(1), direction]))

    def forward(self, voxels: Tensor) -> tuple[Tensor, Tensor]:
        """Predict planes and rotations.

        Args:
            voxels: ``(b, 1, R, R, R)`` float, 1 where the surface is, indices in the order x, y, z over the cube
                ``[-0.5, 0.5]^3`` of the frame the network is fed with.

        Returns:
            planes: ``(b, planes, 4)``, rows ``(n, d)`` with ``|n| = 1`` and ``n.x + d = 0``, in the frame of the input.
            quaternions: ``(b, rotations, 4)``, unit, ``(w, x, y, z)``.
        """
        features = self._features(voxels).flatten(1)
        planes = torch.stack([head(features) for head in self.plane_heads], dim=1)
        if not self.rotation_heads:
            return unit_planes(planes), planes.new_zeros((len(planes), 0, 4))
        quaternions = torch.stack([head(features) for head in self.rotation_heads], dim=1)
        return unit_planes(planes), unit_quaternions(quaternions)

    def _features(self, voxels: Tensor) -> Tensor:
        if voxels.device.type != "cpu":
            return self.features(voxels)
        first = cast(nn.Conv3d, self.features[0])
        features = convolve_and_pool(voxels, first.weight, cast(Tensor, first.bias))
        for layer in list(self.features)[2:]:
            features = convolve(features, layer) if isinstance(layer, nn.Conv3d) else cast(Tensor, layer(features))
        return features

    def blocks(self) -> list[list[nn.Module]]:
        """The layers of `features`, block by block: a convolution and what follows it."""
        blocks: list[list[nn.Module]] = []
        for layer in self.features:
            if isinstance(layer, nn.Conv3d):
                blocks.append([])
            blocks[-1].append(layer)
        return blocks


def unit_planes(planes: Tensor) -> Tensor:
    """Planes ``(..., 4)`` with normals of unit length, the same planes (section 3)."""
    return planes / _length(planes[..., :3]).clamp_min(1e-12)


def unit_quaternions(quaternions: Tensor) -> Tensor:
    """Quaternions ``(..., 4)`` of unit length (section 3)."""
    return quaternions / _length(quaternions).clamp_min(1e-12)


def _length(vectors: Tensor) -> Tensor:
    """Euclidean length over the last dimension, which is kept."""
    return vectors.square().sum(-1, keepdim=True).sqrt()


def _head(features: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(features, features // 2),
        nn.LeakyReLU(LEAKY_SLOPE),
        nn.Linear(features // 2, features // 4),
        nn.LeakyReLU(LEAKY_SLOPE),
        nn.Linear(features // 4, HEAD_OUTPUTS),
    )


def _last_layer(head: nn.Module) -> nn.Linear:
    return cast(nn.Linear, cast(nn.Sequential, head)[-1])


def _set_bias(layer: nn.Linear, bias: Tensor) -> None:
    with torch.no_grad():
        layer.bias.copy_(bias)
