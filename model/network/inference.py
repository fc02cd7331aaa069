"""The trained network arranged for inference on a CPU: what `PRSNet.forward` says, in a fraction of the time.

- A surface fills a few per cent of its grid. Convolution 3^3 and pooling 2^3 together make each output cell of the
  first block a function of the 4^3 voxels around it; where those are empty the output is a constant.
  (`model.network.sparse_block` says the same in torch, for training.)
- That convolution is a sum of three numbers looked up: what the taps of a slab of 3^2 add up to for each of the 512
  choices of voxels under it. All frames of a view, mirror images of one another, share the voxels and the choices:
  instead of the voxels the kernels are mirrored.
- The blocks in between run in bfloat16 where the processor multiplies matrices of it (AMX): two to eight times faster.
  Sums, normalisation and heads stay in float32.
- The last block sees 2^3 cells: its convolution is one matrix. As a convolution its weights would be brought into
  another order at every call, which takes longer than the product.
- All heads are one product a layer.

A network with a layer that is not among these is computed by its own `forward`, at its own speed.
"""

from collections.abc import Sequence
from itertools import product
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor, nn

from model._jit import jit_allocating, kernel_array
from model.network.network import LEAKY_SLOPE, PRSNet, unit_planes, unit_quaternions
from model.network.sparse_block import convolve
from model.types import AnyArray, BoolArray


def fast_dtype() -> torch.dtype:
    """What the blocks between first and heads compute in: bfloat16 if this processor has matrix units for it."""
    return torch.bfloat16 if torch.cpu.get_capabilities().get("amx_bf16", False) else torch.float32


class CpuNetwork:
    """A network in evaluation mode whose weights will not change any more."""

    def __init__(self, network: PRSNet, dtype: torch.dtype | None = None) -> None:
        """Arrange the weights; ``dtype`` float32 or bfloat16, by default `fast_dtype`."""
        self._network = None if _is_plain(network) else network.eval()
        if self._network is not None:
            return
        dtype = dtype or fast_dtype()
        first, *middle = network.blocks()
        convolution = cast(nn.Conv3d, first[0])
        scale, shift = _normalisation(first)
        self._kernels = convolution.weight.detach()[:, 0].permute(1, 2, 3, 0).contiguous().numpy()
        self._known_sums: dict[bytes, AnyArray] = {}
        self._scale, self._shift = _numbers(scale), _numbers(shift)
        last = middle.pop() if middle else None
        self._middle = [_Block(block, dtype) for block in middle]
        self._last = None if last is None else _LastBlock(last, dtype)
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
            if self._network is not None:
                return self._network(_frames(views))
            features = self._first_block(views)
            for block in self._middle:
                features = block(features)
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
        half, channels = len(views[0][0]) // 2, len(self._scale)
        out = np.empty((sum(len(flips) for _, flips in views), half, half, half, channels), dtype=np.float32)
        first, slope = 0, np.float32(LEAKY_SLOPE)
        for occupied, flips in views:
            under, flags = kernel_array(_slab_codes(occupied), np.uint16), kernel_array(flips, np.uint8)
            own = out[first : first + len(flips)]
            _first_block(under, self._mirrored_sums(flips), self._scale, self._shift, slope, flags, own)
            first += len(flips)
        result: Tensor = torch.from_numpy(out)  # pyright: ignore[reportUnknownMemberType]
        return result.permute(0, 4, 1, 2, 3)

    def _mirrored_sums(self, flips: BoolArray) -> AnyArray:
        """`_sums` of the first kernels as each frame sees them, ``(3, 512, f c)``; there are few choices of frames."""
        key = flips.tobytes()
        if key not in self._known_sums:
            mirrored: list[AnyArray] = [self._kernels[::x, ::y, ::z] for x, y, z in np.where(flips, -1, 1).tolist()]
            self._known_sums[key] = kernel_array(_sums(np.concatenate(mirrored, axis=3)), np.float32)
        return self._known_sums[key]


def _is_plain(network: PRSNet) -> bool:
    """Whether every block is convolution, pooling, normalisation or none, and activation, as arranged here."""
    plain = [nn.Conv3d, nn.MaxPool3d, nn.BatchNorm3d, nn.LeakyReLU]
    kinds = [[type(layer) for layer in block] for block in network.blocks()]
    return all(found in (plain, [*plain[:2], plain[3]]) for found in kinds)


def _frames(views: Sequence[tuple[BoolArray, BoolArray]]) -> Tensor:
    """The voxels of all frames, ``(F, 1, R, R, R)`` float32."""
    grids: list[AnyArray] = [
        occupied[::x, ::y, ::z] for occupied, flips in views for x, y, z in np.where(flips, -1, 1).tolist()
    ]
    voxels: Tensor = torch.from_numpy(np.stack(grids).astype(np.float32))  # pyright: ignore[reportUnknownMemberType]
    return voxels[:, None]


class _Block:
    """Convolution, pooling, normalisation and activation on float32 features."""

    def __init__(self, block: Sequence[nn.Module], dtype: torch.dtype) -> None:
        self._dtype = dtype
        # A copy without bias: that is part of the shift, which stays in float32.
        trained = cast(nn.Conv3d, block[0])
        self._convolution = nn.Conv3d(trained.in_channels, trained.out_channels, 3, padding=1, bias=False, dtype=dtype)
        self._convolution.requires_grad_(False)
        self._convolution.weight.copy_(trained.weight.detach())
        # In this order oneDNN rearranges the weights faster, which it does at every call.
        self._convolution.to(memory_format=torch.channels_last_3d)  # pyright: ignore[reportCallIssue] - not in the stubs
        scale, shift = _normalisation(block)
        self._scale, self._shift = (values[:, None, None, None] for values in (scale, shift))

    def __call__(self, features: Tensor) -> Tensor:
        """``(b, c, R, R, R)`` to ``(b, c out, R/2, R/2, R/2)``, both in the channels-last memory format."""
        pooled = convolve(features.to(self._dtype), self._convolution)
        for axis in (2, 3, 4):  # half the time of max_pool3d
            pairs = pooled.transpose(2, axis)
            pooled = torch.maximum(pairs[:, :, 0::2], pairs[:, :, 1::2]).transpose(2, axis)
        return nn.functional.leaky_relu_(pooled * self._scale + self._shift, LEAKY_SLOPE)


class _LastBlock:
    """A block on 2^3 cells, as a matrix from (channel, cell) to (cell, channel)."""

    def __init__(self, block: Sequence[nn.Module], dtype: torch.dtype) -> None:
        convolution = cast(nn.Conv3d, block[0])
        weight = convolution.weight.detach()
        cells = list(product((0, 1), repeat=3))
        # From cell a to cell b goes the tap that stands at a - b from the kernel's middle.
        taps = [[weight[:, :, x - i + 1, y - j + 1, z - k + 1] for x, y, z in cells] for i, j, k in cells]
        rows = torch.stack([torch.stack(row, dim=-1) for row in taps])  # (to, out, in, from)
        self._matrix = rows.reshape(8 * len(weight), -1).to(dtype)
        self._scale, self._shift = _normalisation(block)

    def __call__(self, features: Tensor) -> Tensor:
        """``(b, channels, 2, 2, 2)`` to ``(b, channels out)``."""
        cells = nn.functional.linear(features.flatten(1).to(self._matrix.dtype), self._matrix)
        pooled = cells.view(len(features), 8, -1).amax(1)
        return nn.functional.leaky_relu_(pooled * self._scale + self._shift, LEAKY_SLOPE)


def _normalisation(block: Sequence[nn.Module]) -> tuple[Tensor, Tensor]:
    """Bias and, in evaluation mode, batch normalisation as ``scale x + shift``, each ``(c,)``."""
    convolution, normalisation = cast(nn.Conv3d, block[0]), block[2]
    bias = cast(Tensor, convolution.bias).detach()
    if not isinstance(normalisation, nn.BatchNorm3d):
        return torch.ones_like(bias), bias
    mean, variance = cast(Tensor, normalisation.running_mean), cast(Tensor, normalisation.running_var)
    scale = normalisation.weight.detach() / (variance + normalisation.eps).sqrt()
    return scale, normalisation.bias.detach() + (bias - mean) * scale


def _stacked(layers: Sequence[nn.Linear]) -> tuple[Tensor, Tensor]:
    """Layers of equal size side by side: weights ``(h, in, out)``, biases ``(h, 1, out)``."""
    weights = torch.stack([layer.weight.detach().t() for layer in layers])
    return weights.contiguous(), torch.stack([layer.bias.detach() for layer in layers])[:, None]


def _numbers(values: Tensor) -> AnyArray:
    return kernel_array(values.numpy(), np.float32)


def _sums(kernels: AnyArray) -> AnyArray:
    """Sums of the taps of 3^2 for every choice of them: ``(3, 3, 3, ...)`` to ``(3, 512, ...)``, one row a slab.

    Opposite taps are added first, so that a mirrored kernel gives the same numbers to the last bit.
    """
    chosen = np.arange(512)[:, None] >> np.arange(9) & 1
    taps = chosen.reshape(1, 512, 3, 3, *[1] * (kernels.ndim - 3)).astype(np.float32) * kernels[:, None]
    rows = taps[:, :, 0] + taps[:, :, 2] + taps[:, :, 1]
    return rows[:, :, 0] + rows[:, :, 2] + rows[:, :, 1]


def _slab_codes(occupied: BoolArray) -> AnyArray:
    """Which of the 3^2 voxels of a slab across x lie under the kernel, as a row of `_sums`: ``(R + 2, R, R)`` uint16.

    Slabs are counted from one before the grid; within them the kernel stands on every voxel.
    """
    edge = len(occupied)
    padded = np.zeros((edge + 2,) * 3, dtype=np.uint16)  # np.pad takes longer than all the rest
    padded[1:-1, 1:-1, 1:-1] = occupied
    rows = padded[:, :, :-2] | padded[:, :, 1:-1] << 1 | padded[:, :, 2:] << 2
    return rows[:, :-2] | rows[:, 1:-1] << 3 | rows[:, 2:] << 6


@jit_allocating
def _first_block(
    under: AnyArray, sums: AnyArray, scale: AnyArray, shift: AnyArray, slope: Any, flips: AnyArray, out: AnyArray
) -> None:
    """Fill ``out`` ``(f, h, h, h, c)`` of frames ``flips`` ``(f, 3)``; ``sums`` ``(3, 512, f c)`` are of all frames."""
    half = under.shape[1] // 2
    frames, width = flips.shape[0], sums.shape[2]
    channels = width // frames
    cells = out.reshape(-1, channels)
    for row in range(len(cells)):
        for c in range(channels):
            cells[row, c] = shift[c] if shift[c] > 0 else slope * shift[c]
    largest = np.empty(width, dtype=np.float32)
    for i in range(half):
        for j in range(half):
            for k in range(half):
                # The cell's four slabs, the kernel in its places along y and z.
                any_voxel = under[2 * i, 2 * j, 2 * k]
                for a in range(4):
                    for b in range(2):
                        for e in range(2):
                            any_voxel |= under[2 * i + a, 2 * j + b, 2 * k + e]
                if not any_voxel:
                    continue
                largest[:] = -np.inf
                for a in range(2):
                    for b in range(2):
                        for e in range(2):
                            first = sums[0, under[2 * i + a, 2 * j + b, 2 * k + e]]
                            middle = sums[1, under[2 * i + a + 1, 2 * j + b, 2 * k + e]]
                            last = sums[2, under[2 * i + a + 2, 2 * j + b, 2 * k + e]]
                            for w in range(width):
                                largest[w] = max(largest[w], first[w] + last[w] + middle[w])
                for frame in range(frames):
                    x = half - 1 - i if flips[frame, 0] else i
                    y = half - 1 - j if flips[frame, 1] else j
                    z = half - 1 - k if flips[frame, 2] else k
                    for c in range(channels):
                        value = largest[frame * channels + c] * scale[c] + shift[c]
                        out[frame, x, y, z, c] = value if value > 0 else slope * value
