"""The trained network arranged for inference on a CPU: what `PRSNet.forward` says, in a fraction of the time.

It needs no torch, whose import takes longer than all else that a detection needs (docs/decisions/0012). Sums are taken
in one order on every processor, so that the answer is the same to the last bit.

- A surface fills a few per cent of its grid. Convolution 3^3 and pooling 2^3 together make each output cell of the
  first block a function of the 4^3 voxels around it; where those are empty the output is a constant.
  (`model.network.sparse_block` says the same in torch, for training.)
- That convolution is a sum of three numbers looked up: what the taps of a slab of 3^2 add up to for each of the 512
  choices of voxels under it. All frames of a view, mirror images of one another, share the voxels and the choices:
  instead of the voxels the kernels are mirrored.
- Of the second block's input, too, most cells hold that constant. What it convolves to is known beforehand; only what
  differs from it is added.
- All heads are one product in their first layer.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from model._jit import jit, jit_allocating, kernel_array
from model.network.architecture import LEAKY_SLOPE, NORMALISATION_EPSILON, Architecture
from model.types import AnyArray, BoolArray

_SLOPE = np.float32(LEAKY_SLOPE)


class CpuNetwork:
    """A network in evaluation mode whose weights will not change any more."""

    def __init__(self, architecture: Architecture, weights: Mapping[str, AnyArray]) -> None:
        """Arrange the weights, named and shaped as ``architecture.weight_shapes()`` says."""
        (first, normalisation), *rest = architecture.block_names
        self._kernels = np.ascontiguousarray(weights[f"{first}weight"][:, 0].transpose(1, 2, 3, 0))
        self._known_sums: dict[bytes, AnyArray] = {}
        self._scale, self._shift = _normalisation(weights, first, normalisation)
        constant = np.where(self._shift > 0, self._shift, _SLOPE * self._shift)
        self._blocks: list[_Block] = []
        for block, names in enumerate(rest, 1):
            self._blocks.append(_Block(weights, *names, architecture.resolution >> block, constant))
            constant = np.zeros(self._blocks[-1].channels, dtype=np.float32)
        self._planes = architecture.planes
        self._layers = [_stacked(weights, architecture.head_names, layer) for layer in (0, 2, 4)]

    def __call__(self, *views: tuple[BoolArray, BoolArray]) -> tuple[AnyArray, AnyArray]:
        """What `PRSNet.forward` returns for the frames of several views, in one batch.

        Args:
            views: of each its voxels ``(R, R, R)`` and ``(f, 3)``, the axes along which each of its frames is mirrored.

        Returns:
            planes ``(F, p, 4)`` and quaternions ``(F, r, 4)`` float32 of all frames in order, each in its own frame.
        """
        features = self._first_block(views)
        for block in self._blocks:
            features = block(features)
        frames, heads = len(features), len(self._layers[0][0])
        values = np.broadcast_to(features.reshape(frames, 1, -1), (frames, heads, features.shape[-1]))
        for row, (weight, bias) in enumerate(self._layers):
            values = kernel_array(values, np.float32)
            out = np.empty((frames, heads, bias.shape[1]), dtype=np.float32)
            nothing = np.zeros(values.shape[2], dtype=np.float32)
            _layer(values, nothing, weight, bias, _SLOPE if row < 2 else np.float32(1.0), out)
            values = out
        planes, quaternions = values[:, : self._planes], values[:, self._planes :]
        return planes / _length(planes[..., :3]), quaternions / _length(quaternions)

    def _first_block(self, views: Sequence[tuple[BoolArray, BoolArray]]) -> AnyArray:
        """``(F, R/2, R/2, R/2, c)`` float32."""
        half, channels = len(views[0][0]) // 2, len(self._scale)
        out = np.empty((sum(len(flips) for _, flips in views), half, half, half, channels), dtype=np.float32)
        first = 0
        for occupied, flips in views:
            under, flags = kernel_array(_slab_codes(occupied), np.uint16), kernel_array(flips, np.uint8)
            own = out[first : first + len(flips)]
            _first_block(under, self._mirrored_sums(flips), self._scale, self._shift, _SLOPE, flags, own)
            first += len(flips)
        return out

    def _mirrored_sums(self, flips: BoolArray) -> AnyArray:
        """`_sums` of the first kernels as each frame sees them, ``(3, 512, f c)``; there are few choices of frames."""
        key = flips.tobytes()
        if key not in self._known_sums:
            mirrored: list[AnyArray] = [self._kernels[::x, ::y, ::z] for x, y, z in np.where(flips, -1, 1).tolist()]
            self._known_sums[key] = kernel_array(_sums(np.concatenate(mirrored, axis=3)), np.float32)
        return self._known_sums[key]


class _Block:
    """Convolution, pooling, normalisation and activation."""

    def __init__(
        self, weights: Mapping[str, AnyArray], convolution: str, normalisation: str, edge: int, constant: AnyArray
    ) -> None:
        """Arrange a block on ``edge``^3 cells, of which those without surface hold ``constant`` ``(c,)``."""
        taps = weights[f"{convolution}weight"].transpose(2, 3, 1, 4, 0)  # (x, y, c in, z, c out)
        # A cell is added to its neighbours: what the kernel's last tap brings to a cell comes from the one after it.
        taps = taps[::-1, ::-1, :, ::-1]
        self.channels = taps.shape[4]
        self._taps = kernel_array(taps.reshape(9, -1), np.float32)
        self._scale, self._shift = _normalisation(weights, convolution, normalisation)
        self._constant = kernel_array(constant, np.float32)
        self._base = np.zeros((edge + 2, edge + 2, edge + 2, self.channels), dtype=np.float32)
        if constant.any():
            everywhere = np.broadcast_to(self._constant, (edge, edge, edge, len(constant)))
            nothing = np.zeros_like(self._constant)
            _convolve(kernel_array(everywhere, np.float32), nothing, self._taps, self._base.ravel())

    def __call__(self, features: AnyArray) -> AnyArray:
        """``(F, R, R, R, c)`` to ``(F, R/2, R/2, R/2, c out)``, float32."""
        half = features.shape[1] // 2
        out = np.empty((len(features), half, half, half, self.channels), dtype=np.float32)
        sums = np.empty_like(self._base)
        for frame in range(len(features)):
            sums[:] = self._base
            _convolve(features[frame], self._constant, self._taps, sums.ravel())
            _pool(sums, self._scale, self._shift, _SLOPE, out[frame])
        return out


def _normalisation(weights: Mapping[str, AnyArray], convolution: str, normalisation: str) -> tuple[AnyArray, AnyArray]:
    """Bias and, in evaluation mode, batch normalisation as ``scale x + shift``, each ``(c,)`` float32."""
    bias = weights[f"{convolution}bias"].astype(np.float32)
    if not normalisation:
        return np.ones_like(bias), kernel_array(bias, np.float32)
    gain, offset, mean, variance = (
        weights[f"{normalisation}{name}"].astype(np.float32)
        for name in ("weight", "bias", "running_mean", "running_var")
    )
    scale = gain / np.sqrt(variance + np.float32(NORMALISATION_EPSILON))
    return kernel_array(scale, np.float32), kernel_array(offset + (bias - mean) * scale, np.float32)


def _stacked(weights: Mapping[str, AnyArray], heads: Sequence[str], layer: int) -> tuple[AnyArray, AnyArray]:
    """A layer of all heads side by side: weights ``(h, in out)``, biases ``(h, out)``."""
    matrices = np.stack([weights[f"{head}{layer}.weight"].T.ravel() for head in heads])
    biases = np.stack([weights[f"{head}{layer}.bias"] for head in heads])
    return kernel_array(matrices, np.float32), kernel_array(biases, np.float32)


def _length(vectors: AnyArray) -> AnyArray:
    """Euclidean length over the last dimension, which is kept; never 0."""
    return np.maximum(np.sqrt(np.square(vectors).sum(-1, keepdims=True)), np.float32(1e-12))


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


@jit
def _convolve(features: AnyArray, constant: AnyArray, taps: AnyArray, sums: AnyArray) -> None:
    """Add what each cell brings to the cells around it to ``sums``, ``(R + 2, R + 2, R + 2, c out)`` flattened.

    ``features`` ``(R, R, R, c)`` count from ``constant`` ``(c,)``; cells that hold it are passed over. ``taps``
    ``(9, 3 c c out)``: of each channel the three neighbours along z lie behind each other.
    """
    edge, channels = features.shape[0], features.shape[3]
    width = taps.shape[1] // channels
    stride = width // 3
    for i in range(edge):
        for j in range(edge):
            for k in range(edge):
                cell = features[i, j, k]
                plain = True
                for c in range(channels):
                    plain = plain and cell[c] == constant[c]
                if plain:
                    continue
                for a in range(3):
                    for b in range(3):
                        if i + a == 0 or i + a > edge or j + b == 0 or j + b > edge:
                            continue  # outside of the grid
                        at = (((i + a) * (edge + 2) + j + b) * (edge + 2) + k) * stride
                        _add_product(cell, constant, taps[3 * a + b], sums[at : at + width])


@jit
def _add_product(values: AnyArray, constant: AnyArray, matrix: AnyArray, out: AnyArray) -> None:
    """``out += (values - constant) @ matrix``, the matrix flattened, for one row; eight terms are added pairwise.

    The rows are arrays of their own because only then the loop over them becomes vector instructions. Every sum is
    taken in the same order on every processor.
    """
    rows, width = values.shape[0], out.shape[0]
    row, at = 0, 0
    while row + 8 <= rows:
        v0, v1 = values[row] - constant[row], values[row + 1] - constant[row + 1]
        v2, v3 = values[row + 2] - constant[row + 2], values[row + 3] - constant[row + 3]
        v4, v5 = values[row + 4] - constant[row + 4], values[row + 5] - constant[row + 5]
        v6, v7 = values[row + 6] - constant[row + 6], values[row + 7] - constant[row + 7]
        m0, m1 = matrix[at : at + width], matrix[at + width : at + 2 * width]
        m2, m3 = matrix[at + 2 * width : at + 3 * width], matrix[at + 3 * width : at + 4 * width]
        m4, m5 = matrix[at + 4 * width : at + 5 * width], matrix[at + 5 * width : at + 6 * width]
        m6, m7 = matrix[at + 6 * width : at + 7 * width], matrix[at + 7 * width : at + 8 * width]
        for n in range(width):
            out[n] += ((v0 * m0[n] + v1 * m1[n]) + (v2 * m2[n] + v3 * m3[n])) + (
                (v4 * m4[n] + v5 * m5[n]) + (v6 * m6[n] + v7 * m7[n])
            )
        row += 8
        at += 8 * width
    while row < rows:
        v0, m0 = values[row] - constant[row], matrix[at : at + width]
        for n in range(width):
            out[n] += v0 * m0[n]
        row += 1
        at += width


@jit
def _pool(sums: AnyArray, scale: AnyArray, shift: AnyArray, slope: Any, out: AnyArray) -> None:
    """The largest of every 2^3 of ``sums`` ``(R + 2, R + 2, R + 2, c)``, its rim left out, scaled and activated."""
    half, channels = out.shape[0], out.shape[3]
    for i in range(half):
        for j in range(half):
            for k in range(half):
                cell = out[i, j, k]
                first = sums[2 * i + 1, 2 * j + 1, 2 * k + 1]
                for c in range(channels):
                    cell[c] = first[c]
                for corner in range(1, 8):
                    x, y, z = 2 * i + 1 + (corner >> 2), 2 * j + 1 + (corner >> 1 & 1), 2 * k + 1 + (corner & 1)
                    other = sums[x, y, z]
                    for c in range(channels):
                        cell[c] = max(cell[c], other[c])
                for c in range(channels):
                    value = cell[c] * scale[c] + shift[c]
                    cell[c] = value if value > 0 else slope * value


@jit
def _layer(values: AnyArray, nothing: AnyArray, weight: AnyArray, bias: AnyArray, slope: Any, out: AnyArray) -> None:
    """A fully connected layer of all heads: ``values`` ``(F, h, in)`` to ``out`` ``(F, h, out)``.

    ``nothing`` are zeros ``(in,)``, from which the values are counted.
    """
    for head in range(values.shape[1]):  # whose weights stay at hand for all frames
        for frame in range(values.shape[0]):
            row = out[frame, head]
            for n in range(row.shape[0]):
                row[n] = bias[head, n]
            _add_product(values[frame, head], nothing, weight[head], row)
            for n in range(row.shape[0]):
                row[n] = row[n] if row[n] > 0 else slope * row[n]
