"""Checkpoints: `NAME.safetensors` holds the weights, `NAME.json` beside it says what they are. Never a pickle."""

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol, cast

from safetensors import SafetensorError
from safetensors.numpy import load as load_tensors
from safetensors.numpy import save as save_tensors

from model.errors import CheckpointError
from model.network.architecture import Architecture
from model.network.inference import CpuNetwork
from model.types import AnyArray, BoolArray

if TYPE_CHECKING:  # torch takes longer to import than all the rest, and a detection does without it
    from model.network.network import PRSNet

FORMAT_VERSION = 1
SHIPPED = Path(__file__).parents[1] / "weights"
REQUIRED = ("format", "name", "version", "architecture", "input", "recipe", "data", "git_revision", "metrics", "sha256")


@dataclass(frozen=True, slots=True)
class InputSpec:
    """How a shape is presented to the network, decided when it was trained.

    ``frame``: ``unit`` feeds the unit frame as it is (the paper), ``inertia`` the unit frame turned to the
    eigenvectors of the surface covariance. ``passes``: after each pass but the last, the input is turned into the
    frame of the predicted normals and predicted again. ``sign_frames``: how many of the eight sign choices of a frame
    are looked at. ``views``: 3 looks from two further frames in the last pass, 1 does not. Of several answers those are
    chosen that fit the voxels (`model.network.views`).
    """

    frame: Literal["unit", "inertia"] = "unit"
    passes: int = 1
    sign_frames: int = 1
    views: int = 1

    def __post_init__(self) -> None:
        if self.frame not in ("unit", "inertia") or not 1 <= self.passes <= 8:
            raise ValueError("frame must be unit or inertia, passes 1 to 8")
        if not 1 <= self.sign_frames <= 8 or self.views not in (1, 3):
            raise ValueError("sign_frames must be 1 to 8, views 1 or 3")


class CompiledNetwork(Protocol):
    """`model.network.inference.CpuNetwork`, or whatever answers like it."""

    def __call__(self, *views: tuple[BoolArray, BoolArray]) -> tuple[AnyArray, AnyArray]:
        """Planes ``(F, p, 4)`` and quaternions ``(F, r, 4)`` of the frames of several views."""
        ...


@dataclass(frozen=True)
class Checkpoint:
    """A network ready for inference, how to feed it, and its whole record; ``weights`` by their names in torch."""

    architecture: Architecture
    weights: Mapping[str, AnyArray]
    input: InputSpec
    metadata: Mapping[str, Any]
    given: "PRSNet | None" = None

    @classmethod
    def of(cls, network: "PRSNet", spec: InputSpec, metadata: Mapping[str, Any]) -> "Checkpoint":
        """A checkpoint of a network at hand; its weights must not change any more."""
        return cls(network.architecture, weights_of(network), spec, metadata, network)

    @cached_property
    def network(self) -> "PRSNet":
        """The network for torch, in evaluation mode."""
        import torch

        from model.network.network import PRSNet

        network = self.given
        if network is None:
            network = PRSNet(self.architecture)
            network.load_state_dict({name: torch.tensor(value) for name, value in self.weights.items()})
        return network.eval().requires_grad_(False)

    @property
    def is_plain(self) -> bool:
        """Whether the weights are those of the layers that inference arranges, and of no other."""
        return {name: value.shape for name, value in self.weights.items()} == self.architecture.weight_shapes()

    @cached_property
    def compiled(self) -> CompiledNetwork:
        """The network as the detector runs it."""
        if self.is_plain:
            return CpuNetwork(self.architecture, self.weights)
        from model.network.forward import ForwardNetwork

        return ForwardNetwork(self.network)


def weights_of(network: "PRSNet") -> dict[str, AnyArray]:
    """The weights of a network by their names in torch."""
    return {name: value.detach().cpu().contiguous().numpy() for name, value in network.state_dict().items()}


def save_checkpoint(path: str | os.PathLike[str], network: "PRSNet", metadata: Mapping[str, Any]) -> None:
    """Write ``path`` (`.safetensors`) and its metadata (`.json`); architecture and sha256 are filled in here.

    Raises:
        CheckpointError: the metadata lacks a required field.
    """
    path = Path(path)
    payload = save_tensors(weights_of(network))
    record = {
        "format": FORMAT_VERSION,
        **metadata,
        "architecture": network.architecture.to_dict(),
        "sha256": hashlib.sha256(payload).hexdigest(),
    }
    missing = [key for key in REQUIRED if key not in record]
    if missing:
        raise CheckpointError(f"The metadata lacks {', '.join(missing)}.")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(payload)
    path.with_suffix(".json").write_text(json.dumps(record, indent=1) + "\n")


def load_checkpoint(weights: str | os.PathLike[str] = "default") -> Checkpoint:
    """Load shipped weights by name (``default``, ``paper``) or any checkpoint by the path of its `.safetensors`.

    Raises:
        CheckpointError: a file is missing or damaged, or weights and metadata do not belong together.
    """
    path = Path(weights)
    if path.suffix != ".safetensors":
        path = SHIPPED / f"{weights}.safetensors"
        if not path.is_file():
            known = ", ".join(sorted(file.stem for file in SHIPPED.glob("*.safetensors"))) or "none"
            raise CheckpointError(
                f"There are no shipped weights called {str(weights)!r} (shipped: {known}); "
                "your own are given by the path of their .safetensors file."
            )
    beside = path.with_suffix(".json")
    try:
        payload, text = path.read_bytes(), beside.read_text()
    except OSError as error:
        raise CheckpointError(f"{error.filename} cannot be read: {error.strerror}.") from error
    record = _parse(text, beside)
    if hashlib.sha256(payload).hexdigest() != record["sha256"]:
        raise CheckpointError(f"{path.name} is not the file {beside.name} describes: the sha256 differs.")
    try:
        architecture = Architecture(**record["architecture"])
        spec = InputSpec(**record["input"])
        checkpoint = Checkpoint(architecture, load_tensors(payload), spec, record)
        if not checkpoint.is_plain:
            _ = checkpoint.network  # what does not fit it is refused here
    except (TypeError, ValueError, RuntimeError, SafetensorError) as error:
        raise CheckpointError(f"{path.name} does not fit the network that {beside.name} describes: {error}") from error
    return checkpoint


def _parse(text: str, source: Path) -> dict[str, Any]:
    try:
        record: Any = json.loads(text)
    except json.JSONDecodeError as error:
        raise CheckpointError(f"{source.name} is not valid JSON.") from error
    if not isinstance(record, dict):
        raise CheckpointError(f"{source.name} does not describe a checkpoint.")
    record = cast(dict[str, Any], record)
    missing = [key for key in REQUIRED if key not in record]
    if missing:
        raise CheckpointError(f"{source.name} lacks {', '.join(missing)}.")
    if record["format"] != FORMAT_VERSION:
        raise CheckpointError(f"{source.name} has format {record['format']!r}; this program reads {FORMAT_VERSION}.")
    return record
