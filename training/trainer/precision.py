"""Mixed precision: convolutions in bfloat16 on devices that are faster at it, everything else in float32."""

from contextlib import AbstractContextManager, nullcontext
from typing import Any, Literal

import torch
from torch import Tensor, nn

Precision = Literal["float32", "bf16"]


def mixed(precision: Precision, device: torch.device) -> AbstractContextManager[Any]:
    """What a forward pass runs in."""
    if precision == "float32":
        return nullcontext()
    return torch.autocast(device.type, dtype=torch.bfloat16)


def keep_small_layers_exact(network: nn.Module) -> None:
    """Let fully connected layers, and on a CPU convolutions of very few voxels, compute in float32 inside `mixed`.

    Fully connected layers are small, and what they return are planes: three digits, as bfloat16 has, would be a quarter
    of a degree. Convolutions whose input is smaller than their kernel are small as well, and oneDNN's bfloat16 kernel
    for processors with AVX-512 but without matrix units (jit_bf16:avx512_core_bf16, torch 2.13) leaves parts of the
    gradient of their weights unwritten: arbitrary numbers, up to infinity.
    """
    for module in network.modules():
        if isinstance(module, nn.Linear | nn.Conv3d):
            module.register_forward_pre_hook(_enter)
            module.register_forward_hook(_leave, always_call=True)


def _is_small(module: nn.Module, values: Tensor) -> bool:
    if not isinstance(module, nn.Conv3d):
        return True
    return values.device.type == "cpu" and min(values.shape[2:]) < max(module.kernel_size)


def _enter(module: nn.Module, inputs: tuple[Tensor, ...]) -> tuple[Tensor, ...] | None:
    if not _is_small(module, inputs[0]):
        return None
    exact = torch.autocast(inputs[0].device.type, enabled=False)
    exact.__enter__()
    vars(module)["_exact"] = exact
    return tuple(tensor.float() for tensor in inputs)


def _leave(module: nn.Module, inputs: tuple[Tensor, ...], output: Tensor) -> None:
    exact = vars(module).pop("_exact", None)
    if exact is not None:
        exact.__exit__(None, None, None)
