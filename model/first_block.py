"""The network's first block in one pass over the voxels that hold surface, for inference on a CPU.

A surface fills a few per cent of its grid. Convolution 3^3 and pooling 2^3 together make each output cell a function of
the 4^3 voxels around it; where those are empty the output is a constant. `model.sparse_block` says the same in torch,
for training; here no patch is ever gathered, and normalisation and activation are applied on the way out.
"""

from typing import Any, cast

import numpy as np
import torch
from torch import Tensor, nn

from model._jit import jit_allocating, kernel_array
from model.network import LEAKY_SLOPE, PRSNet
from model.types import AnyArray, BoolArray


def first_block(network: PRSNet, occupied: BoolArray) -> Tensor:
    """What the first block of a network in evaluation mode makes of voxels.

    Args:
        network: gives convolution, normalisation and slope.
        occupied: ``(b, R, R, R)`` bool, x, y, z.

    Returns:
        ``(b, c, R/2, R/2, R/2)`` float32 in the channels-last memory format: input of `PRSNet.after_first_block`.
    """
    convolution = cast(nn.Conv3d, network.features[0])
    normalisation = network.features[2] if network.architecture.batch_norm else None
    weight = convolution.weight.detach()
    taps = weight[:, 0].flatten(1).t().contiguous()
    bias = cast(Tensor, convolution.bias).detach()
    if isinstance(normalisation, nn.BatchNorm3d):
        mean, variance = cast(Tensor, normalisation.running_mean), cast(Tensor, normalisation.running_var)
        scale = normalisation.weight.detach() / (variance + normalisation.eps).sqrt()
        shift = normalisation.bias.detach() - mean * scale
    else:
        scale, shift = torch.ones_like(bias), torch.zeros_like(bias)
    half = occupied.shape[1] // 2
    out = np.empty((len(occupied), half, half, half, len(bias)), dtype=np.float32)
    taps, bias, scale, shift = (kernel_array(tensor.numpy(), np.float32) for tensor in (taps, bias, scale, shift))
    _block(kernel_array(occupied, np.uint8), taps, bias, scale, shift, np.float32(LEAKY_SLOPE), out)
    result: Tensor = torch.from_numpy(out)  # pyright: ignore[reportUnknownMemberType]
    return result.permute(0, 4, 1, 2, 3)


@jit_allocating
def _block(
    occupied: AnyArray, taps: AnyArray, bias: AnyArray, scale: AnyArray, shift: AnyArray, slope: Any, out: AnyArray
) -> None:
    size, edge = occupied.shape[0], occupied.shape[1]
    half, channels = edge // 2, taps.shape[1]
    touched = np.zeros((half, half, half), dtype=np.uint8)
    sums = np.empty((8, channels), dtype=np.float32)
    empty = np.empty(channels, dtype=np.float32)
    for c in range(channels):
        value = bias[c] * scale[c] + shift[c]
        empty[c] = value if value > 0 else slope * value
    for item in range(size):
        touched[:] = 0
        for x in range(edge):
            for y in range(edge):
                for z in range(edge):
                    if occupied[item, x, y, z]:
                        # A cell sees the voxels from 2 i - 1 to 2 i + 2: two cells an axis see this one.
                        for i in range(max(0, (x - 1) // 2), min(half, (x + 1) // 2 + 1)):
                            for j in range(max(0, (y - 1) // 2), min(half, (y + 1) // 2 + 1)):
                                for k in range(max(0, (z - 1) // 2), min(half, (z + 1) // 2 + 1)):
                                    touched[i, j, k] = 1
        for i in range(half):
            for j in range(half):
                for k in range(half):
                    if not touched[i, j, k]:
                        for c in range(channels):
                            out[item, i, j, k, c] = empty[c]
                        continue
                    sums[:] = 0.0
                    for a in range(4):
                        x = 2 * i - 1 + a
                        if x < 0 or x >= edge:
                            continue
                        for b in range(4):
                            y = 2 * j - 1 + b
                            if y < 0 or y >= edge:
                                continue
                            for e in range(4):
                                z = 2 * k - 1 + e
                                if z < 0 or z >= edge or not occupied[item, x, y, z]:
                                    continue
                                # The kernel stands in eight places within the patch; in place p its tap t is here.
                                for p in range(8):
                                    di, dj, dk = a - (p >> 2), b - ((p >> 1) & 1), e - (p & 1)
                                    if 0 <= di < 3 and 0 <= dj < 3 and 0 <= dk < 3:
                                        t = (di * 3 + dj) * 3 + dk
                                        for c in range(channels):
                                            sums[p, c] += taps[t, c]
                    for c in range(channels):
                        largest = sums[0, c]
                        for p in range(1, 8):
                            largest = max(largest, sums[p, c])
                        value = (largest + bias[c]) * scale[c] + shift[c]
                        out[item, i, j, k, c] = value if value > 0 else slope * value
