"""What a network is made of, said without torch: its size, and the names and shapes of its weights."""

from dataclasses import asdict, dataclass
from typing import Any

LEAKY_SLOPE = 0.2
HEAD_OUTPUTS = 4
"""Parameters of a plane ``(n, d)`` and of a quaternion ``(w, x, y, z)`` alike."""

NORMALISATION_EPSILON = 1e-5
"""What batch normalisation adds to a variance."""


@dataclass(frozen=True, slots=True)
class Architecture:
    """What it takes to rebuild a network before its weights are loaded.

    ``resolution`` R is a power of two and gives log2 R convolution blocks. ``width`` multiplies every channel
    count; 1 is the paper's 4, 8, 16, ... ``batch_norm`` puts a batch normalisation behind each pooling (an eighth of
    the work of one behind the convolution), which the paper does not have. ``planes`` and ``rotations`` are the numbers
    of heads, at most three each: the initial directions are the coordinate axes. ``channels``, if given, are the
    channel counts of the blocks instead of the paper's doubling: the late blocks work on few voxels, so that more of
    their channels cost little time.
    """

    resolution: int = 32
    width: int = 1
    batch_norm: bool = False
    planes: int = 3
    rotations: int = 3
    channels: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if self.resolution < 2 or self.resolution & (self.resolution - 1):
            raise ValueError(f"resolution must be a power of two of at least 2, not {self.resolution}")
        if self.width < 1 or not 1 <= self.planes <= 3 or not 0 <= self.rotations <= 3:
            raise ValueError("width must be positive, planes 1 to 3 and rotations 0 to 3")
        object.__setattr__(self, "channels", tuple(self.channels))  # JSON knows lists only
        if self.channels and (len(self.channels) != self.blocks or min(self.channels) < 1):
            raise ValueError(f"channels must be {self.blocks} positive numbers, one a block")

    @property
    def blocks(self) -> int:
        """Convolution blocks, each of which halves the resolution."""
        return self.resolution.bit_length() - 1

    @property
    def block_channels(self) -> tuple[int, ...]:
        """Channels each block puts out; those of the last are the feature vector."""
        return self.channels or tuple(4 * self.width * 2**block for block in range(self.blocks))

    def to_dict(self) -> dict[str, Any]:
        """The fields as plain values, for the metadata of a checkpoint."""
        return asdict(self)

    @property
    def block_names(self) -> list[tuple[str, str]]:
        """Of every block the prefixes of its convolution's and its normalisation's weights, the latter empty if none.

        The names are those that torch gives to the layers of `model.network.network.PRSNet`.
        """
        layers = 4 if self.batch_norm else 3
        return [
            (f"features.{layers * block}.", f"features.{layers * block + 2}." if self.batch_norm else "")
            for block in range(self.blocks)
        ]

    @property
    def head_names(self) -> list[str]:
        """The prefixes of the heads' weights, planes first; their fully connected layers are numbered 0, 2 and 4."""
        return [f"plane_heads.{head}." for head in range(self.planes)] + [
            f"rotation_heads.{head}." for head in range(self.rotations)
        ]

    def weight_shapes(self) -> dict[str, tuple[int, ...]]:
        """Name and shape of all weights."""
        shapes: dict[str, tuple[int, ...]] = {}
        channels_in = 1
        for (convolution, normalisation), channels in zip(self.block_names, self.block_channels, strict=True):
            shapes[f"{convolution}weight"] = (channels, channels_in, 3, 3, 3)
            shapes[f"{convolution}bias"] = (channels,)
            if normalisation:
                for name in ("weight", "bias", "running_mean", "running_var"):
                    shapes[f"{normalisation}{name}"] = (channels,)
                shapes[f"{normalisation}num_batches_tracked"] = ()
            channels_in = channels
        sizes = (channels_in, channels_in // 2, channels_in // 4, HEAD_OUTPUTS)
        for head in self.head_names:
            for layer in range(3):
                shapes[f"{head}{2 * layer}.weight"] = (sizes[layer + 1], sizes[layer])
                shapes[f"{head}{2 * layer}.bias"] = (sizes[layer + 1],)
        return shapes
