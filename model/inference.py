"""The trained network arranged for inference on a CPU: the same numbers as `PRSNet.forward`, in less time.

- A surface fills a few per cent of its grid. Convolution 3^3 and pooling 2^3 together make each output cell of the
  first block a function of the 4^3 voxels around it; where those are empty the output is a constant. Every voxel adds
  its taps where it is seen. (`model.sparse_block` says the same in torch, for training.)
- Frames that are mirror images of one another share the voxels: instead of those the kernels are mirrored.
- The last block sees 2^3 cells: its convolution is one matrix. As a convolution its weights would be brought into
  another order at every call, which takes longer than the product.
- All heads are one product a layer.
"""

from collections.abc import Sequence
from itertools import product
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor, nn

from model._jit import jit_allocating, kernel_array
from model.network import LEAKY_SLOPE, PRSNet, unit_planes, unit_quaternions
from model.sparse_block import convolve
from model.types import AnyArray, BoolArray


class CompiledNetwork:
    """A network in evaluation mode whose weights will not change any more."""

    def __init__(self, network: PRSNet) -> None:
        first, *middle = network.blocks()
        convolution = cast(nn.Conv3d, first[0])
        scale, shift = _normalisation(first)
        self._kernels = convolution.weight.detach()[:, 0].permute(1, 2, 3, 0).contiguous().numpy()
        self._bias = _numbers(cast(Tensor, convolution.bias).detach())
        self._scale, self._shift = _numbers(scale), _numbers(shift)
        last = middle.pop() if middle else None
        self._middle = [layer for block in middle for layer in block]
        self._last = None if last is None else _LastBlock(last)
        self._planes = len(network.plane_heads)
        heads = [cast(nn.Sequential, head) for head in (*network.plane_heads, *network.rotation_heads)]
        self._layers = [_stacked([cast(nn.Linear, head[row]) for head in heads]) for row in (0, 2, 4)]

    def __call__(self, *views: tuple[BoolArray, BoolArray]) -> tuple[Tensor, Tensor]:
        """What `PRSNet.forward` returns for the frames of several views, in one batch.

        Args:
            views: of each its voxels ``(R, R, R)`` and ``(f, 3)``, the axes along which each of its frames is mirrored.

        Returns:
            planes ``(F, p, 4)`` and quaternions ``(F, r, 4)`` of all frames in order, each in its own frame.
        """
        with torch.inference_mode():
            features = self._first_block(views)
            for layer in self._middle:
                features = convolve(features, layer) if isinstance(layer, nn.Conv3d) else cast(Tensor, layer(features))
            features = features.flatten(1) if self._last is None else self._last(features)
            outputs = features.expand(len(self._layers[0][0]), *features.shape)
            for row, (weight, bias) in enumerate(self._layers):
                outputs = torch.baddbmm(bias, outputs, weight)
                if row < len(self._layers) - 1:
                    outputs = nn.functional.leaky_relu(outputs, LEAKY_SLOPE)
            outputs = outputs.transpose(0, 1)
            return unit_planes(outputs[:, : self._planes]), unit_quaternions(outputs[:, self._planes :])

    def _first_block(self, views: Sequence[tuple[BoolArray, BoolArray]]) -> Tensor:
        """``(F, c, R/2, R/2, R/2)`` float32 in the channels-last memory format."""
        half, channels = len(views[0][0]) // 2, len(self._bias)
        out = np.empty((sum(len(flips) for _, flips in views), half, half, half, channels), dtype=np.float32)
        first, slope = 0, np.float32(LEAKY_SLOPE)
        for occupied, flips in views:
            steps = np.where(flips, -1, 1).tolist()
            mirrored: list[AnyArray] = [self._kernels[::x, ::y, ::z] for x, y, z in steps]
            taps = kernel_array(np.stack(mirrored, axis=3).reshape(27, -1), np.float32)
            voxels, flags = kernel_array(occupied, np.uint8), kernel_array(flips, np.uint8)
            own = out[first : first + len(flips)]
            _first_block(voxels, taps, self._bias, self._scale, self._shift, slope, flags, own)
            first += len(flips)
        result: Tensor = torch.from_numpy(out)  # pyright: ignore[reportUnknownMemberType]
        return result.permute(0, 4, 1, 2, 3)


class _LastBlock:
    """A block on 2^3 cells, as a matrix from (channel, cell) to (cell, channel)."""

    def __init__(self, block: Sequence[nn.Module]) -> None:
        convolution = cast(nn.Conv3d, block[0])
        weight = convolution.weight.detach()
        cells = list(product((0, 1), repeat=3))
        # From cell a to cell b goes the tap that stands at a - b from the kernel's middle.
        taps = [[weight[:, :, x - i + 1, y - j + 1, z - k + 1] for x, y, z in cells] for i, j, k in cells]
        rows = torch.stack([torch.stack(row, dim=-1) for row in taps])  # (to, out, in, from)
        self._matrix = rows.permute(2, 3, 0, 1).reshape(-1, 8 * len(weight)).contiguous()
        self._bias = cast(Tensor, convolution.bias).detach()
        self._scale, self._shift = _normalisation(block)

    def __call__(self, features: Tensor) -> Tensor:
        """``(b, channels, 2, 2, 2)`` to ``(b, channels out)``."""
        cells = (features.flatten(1) @ self._matrix).view(len(features), 8, -1)
        pooled = (cells.amax(1) + self._bias) * self._scale + self._shift
        return nn.functional.leaky_relu(pooled, LEAKY_SLOPE)


def _normalisation(block: Sequence[nn.Module]) -> tuple[Tensor, Tensor]:
    """Batch normalisation in evaluation mode as ``scale x + shift``, each ``(c,)``."""
    normalisation = block[2]
    if not isinstance(normalisation, nn.BatchNorm3d):
        channels = cast(nn.Conv3d, block[0]).out_channels
        return torch.ones(channels), torch.zeros(channels)
    mean, variance = cast(Tensor, normalisation.running_mean), cast(Tensor, normalisation.running_var)
    scale = normalisation.weight.detach() / (variance + normalisation.eps).sqrt()
    return scale, normalisation.bias.detach() - mean * scale


def _stacked(layers: Sequence[nn.Linear]) -> tuple[Tensor, Tensor]:
    """Layers of equal size side by side: weights ``(h, in, out)``, biases ``(h, 1, out)``."""
    weights = torch.stack([layer.weight.detach().t() for layer in layers])
    return weights.contiguous(), torch.stack([layer.bias.detach() for layer in layers])[:, None]


def _numbers(values: Tensor) -> AnyArray:
    return kernel_array(values.numpy(), np.float32)


@jit_allocating
def _first_block(
    occupied: AnyArray,
    taps: AnyArray,
    bias: AnyArray,
    scale: AnyArray,
    shift: AnyArray,
    slope: Any,
    flips: AnyArray,
    out: AnyArray,
) -> None:
    """``out`` ``(f, h, h, h, c)`` for frames ``flips`` ``(f, 3)``; ``taps`` ``(27, f c)`` of the mirrored kernels."""
    edge, half = occupied.shape[0], occupied.shape[0] // 2
    frames, width = flips.shape[0], taps.shape[1]
    channels = width // frames
    filled = 0
    for x in range(edge):
        for y in range(edge):
            for z in range(edge):
                filled += occupied[x, y, z]
    # Every voxel is seen by eight cells at most. A cell's eight rows are the kernel's places within its patch.
    sums = np.zeros((min(half**3, 8 * filled), 8, width), dtype=np.float32)
    places = np.full((half, half, half), -1, dtype=np.int32)
    used = 0
    for x in range(edge):
        for y in range(edge):
            for z in range(edge):
                if not occupied[x, y, z]:
                    continue
                # Cell i sees the voxels from 2 i - 1 to 2 i + 2.
                for i in range(max(0, (x - 1) // 2), min(half, (x + 1) // 2 + 1)):
                    for j in range(max(0, (y - 1) // 2), min(half, (y + 1) // 2 + 1)):
                        for k in range(max(0, (z - 1) // 2), min(half, (z + 1) // 2 + 1)):
                            row = places[i, j, k]
                            if row < 0:
                                row = used
                                places[i, j, k] = row
                                used += 1
                            a, b, e = x - 2 * i + 1, y - 2 * j + 1, z - 2 * k + 1
                            for pi in range(max(0, a - 2), min(1, a) + 1):
                                for pj in range(max(0, b - 2), min(1, b) + 1):
                                    for pk in range(max(0, e - 2), min(1, e) + 1):
                                        tap = ((a - pi) * 3 + b - pj) * 3 + e - pk
                                        place = (pi * 2 + pj) * 2 + pk
                                        for w in range(width):
                                            sums[row, place, w] += taps[tap, w]
    largest = np.empty(width, dtype=np.float32)
    for i in range(half):
        for j in range(half):
            for k in range(half):
                row = places[i, j, k]
                largest[:] = 0.0
                if row >= 0:
                    for w in range(width):
                        largest[w] = sums[row, 0, w]
                    for place in range(1, 8):
                        for w in range(width):
                            largest[w] = max(largest[w], sums[row, place, w])
                for frame in range(frames):
                    x = half - 1 - i if flips[frame, 0] else i
                    y = half - 1 - j if flips[frame, 1] else j
                    z = half - 1 - k if flips[frame, 2] else k
                    for c in range(channels):
                        value = (largest[frame * channels + c] + bias[c]) * scale[c] + shift[c]
                        out[frame, x, y, z, c] = value if value > 0 else slope * value
