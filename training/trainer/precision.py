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


def keep_heads_exact(network: nn.Module) -> None:
    """Let fully connected layers compute in float32 inside `mixed`, too.

    They are small, and what they return are planes: three digits, as bfloat16 has, would be a quarter of a degree.
    """
    for module in network.modules():
        if isinstance(module, nn.Linear):
            module.register_forward_pre_hook(_enter)
            module.register_forward_hook(_leave, always_call=True)


def _enter(module: nn.Module, inputs: tuple[Tensor, ...]) -> tuple[Tensor, ...]:
    exact = torch.autocast(inputs[0].device.type, enabled=False)
    exact.__enter__()
    vars(module)["_exact"] = exact
    return tuple(tensor.float() for tensor in inputs)


def _leave(module: nn.Module, inputs: tuple[Tensor, ...], output: Tensor) -> None:
    vars(module).pop("_exact").__exit__(None, None, None)
