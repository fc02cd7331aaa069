"""Several processes that train one network together, as `torchrun` starts them.

The result is that of one process at the same batch size, up to rounding: every process draws the random numbers of the
whole batch and goes on with its own part of it, gradients are averaged by DistributedDataParallel, and batch
normalisation takes its statistics over the whole batch.
"""

import gc
import io
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
import torch.distributed as dist

# Its functions take the group that exists when it is imported as a default (torch 2.13), and DistributedDataParallel
# imports it: a group that is there already would be held until the interpreter ends, and a thread of gloo's that then
# drops the last tensor aborts the process.
import torch.distributed.nn
from torch import Tensor, nn
from torch._C._distributed_c10d import PrefixStore, TCPStore
from torch.nn.parallel import DistributedDataParallel


@dataclass(frozen=True, slots=True)
class World:
    """This process among all of them: its ``rank`` of ``size`` and its ``device``."""

    device: torch.device
    rank: int = 0
    size: int = 1

    @property
    def main(self) -> bool:
        """Whether this is the process that writes files."""
        return self.rank == 0

    def part(self, count: int) -> slice:
        """This process's part of a batch of ``count``.

        Raises:
            ValueError: the batch cannot be divided evenly, so that means over parts would not be means over the whole.
        """
        if count % self.size:
            raise ValueError(f"a batch of {count} cannot be divided evenly among {self.size} processes")
        each = count // self.size
        return slice(self.rank * each, (self.rank + 1) * each)

    def mean(self, values: Tensor) -> Tensor:
        """The mean of every process's ``values``, detached."""
        values = values.detach().clone()
        if self.size > 1:
            dist.all_reduce(values)
        return values / self.size

    def joined(self, values: Tensor) -> Tensor:
        """Every process's part ``(b, ...)`` of a batch, one after the other, detached."""
        values = values.detach().contiguous()
        if self.size == 1:
            return values
        parts = [torch.empty_like(values) for _ in range(self.size)]
        dist.all_gather(parts, values)
        return torch.cat(parts)

    def agreed(self, flag: bool) -> bool:
        """What the main process says."""
        if self.size == 1:
            return flag
        agreed = torch.tensor([int(flag)], device=self.device)
        dist.broadcast(agreed, 0)
        return bool(agreed.item())

    def shared(self, value: Any) -> Any:
        """What the main process has, as every process's own copy; tensors on the CPU."""
        if self.size == 1:
            return value
        packed = io.BytesIO()
        torch.save(value if self.main else None, packed)
        size = torch.tensor([packed.tell()], device=self.device)
        dist.broadcast(size, 0)
        content = torch.frombuffer(bytearray(packed.getvalue()), dtype=torch.uint8)
        content = (
            content.to(self.device) if self.main else torch.empty(int(size), dtype=torch.uint8, device=self.device)
        )
        dist.broadcast(content, 0)
        return torch.load(io.BytesIO(content.cpu().numpy().tobytes()), map_location="cpu", weights_only=True)

    def in_turn(self, work: Callable[[], Any]) -> Any:
        """``work()`` in the main process first, then in all others, which find what it left."""
        if self.main:
            done = work()
            self._wait()
            return done
        self._wait()
        return work()

    def wrapped(self, network: nn.Module) -> nn.Module:
        """The network as one among several: statistics and gradients are those of the whole batch."""
        if self.size == 1:
            return network
        share_statistics(network)
        # Statistics are the same everywhere: nothing to broadcast.
        return DistributedDataParallel(network, forward_sync_buffers=False)

    def close(self) -> None:
        """Leave the group of processes and end its threads. Networks it was ``wrapped`` about have to be gone."""
        if self.size > 1:
            dist.destroy_process_group()
            gc.collect()

    def _wait(self) -> None:
        if self.size > 1:
            dist.barrier()


def join(device: str | None) -> World:
    """Join the process group as `torchrun` numbered this process; without it there is one process.

    Args:
        device: ``cuda``, ``cpu``, ...; by default a GPU, one for each process, where there is one.
    """
    name = device or ("cuda" if torch.cuda.is_available() else "cpu")
    size = int(os.environ.get("WORLD_SIZE", "1"))
    if size == 1 or "RANK" not in os.environ:
        return World(torch.device(name))
    if name == "cuda":
        name = f"cuda:{os.environ.get('LOCAL_RANK', '0')}"
        torch.cuda.set_device(name)
    rank, backend = int(os.environ["RANK"]), "nccl" if name.startswith("cuda") else "gloo"
    if os.environ.get("TORCHELASTIC_USE_AGENT_STORE") == "True":
        dist.init_process_group(backend, store=_meeting_place(size), rank=rank, world_size=size)
    else:
        dist.init_process_group(backend)
    return World(torch.device(name), dist.get_rank(), dist.get_world_size())


def _meeting_place(size: int) -> PrefixStore:
    """Where the processes of one attempt leave their addresses for each other.

    The store that `torchrun` keeps outlives an attempt (torch 2.13): after a restart processes would find there, and
    call, those that were killed.
    """
    store = TCPStore(os.environ["MASTER_ADDR"], int(os.environ["MASTER_PORT"]), is_master=False)
    return PrefixStore(f"prsnet/{os.environ.get('TORCHELASTIC_RESTART_COUNT', '0')}/{size}", store)


def share_statistics(network: nn.Module) -> None:
    """Let every batch normalisation of ``network`` take its statistics over all processes, in place.

    torch's own SyncBatchNorm works on GPUs only.
    """
    for module in network.modules():
        if isinstance(module, nn.modules.batchnorm._BatchNorm):
            module.__class__ = _SHARED[type(module)]


class _Sum(torch.autograd.Function):
    """The sum over all processes; its gradient is the sum of theirs."""

    @staticmethod
    def forward(ctx: Any, values: Tensor) -> Tensor:
        total = values.clone()
        dist.all_reduce(total)
        return total

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> Tensor:
        total = gradients[0].contiguous().clone()
        dist.all_reduce(total)
        return total


class _Shared(nn.modules.batchnorm._BatchNorm):
    def forward(self, input: Tensor) -> Tensor:
        """Normalise with the statistics of all processes' parts, which are equally large."""
        if not self.training:
            return super().forward(input)
        axes = [axis for axis in range(input.dim()) if axis != 1]
        shape = [1, -1] + [1] * (input.dim() - 2)
        size = dist.get_world_size()
        mean = _apply(input.mean(axes)) / size
        centred = input - mean.view(shape)
        variance = _apply(centred.square().mean(axes)) / size
        count = input.numel() // input.shape[1] * size
        self._track(mean.detach(), variance.detach() * count / (count - 1))
        scaled = centred * (variance + self.eps).rsqrt().view(shape)
        return scaled * self.weight.view(shape) + self.bias.view(shape)

    @torch.no_grad()
    def _track(self, mean: Tensor, variance: Tensor) -> None:
        momentum = 0.1 if self.momentum is None else self.momentum
        if self.running_mean is not None and self.running_var is not None and self.num_batches_tracked is not None:
            self.running_mean.lerp_(mean, momentum)
            self.running_var.lerp_(variance, momentum)
            self.num_batches_tracked.add_(1)


class _Shared1d(_Shared, nn.BatchNorm1d):
    pass


class _Shared3d(_Shared, nn.BatchNorm3d):
    pass


_SHARED: dict[type, type] = {nn.BatchNorm1d: _Shared1d, nn.BatchNorm3d: _Shared3d}


def _apply(values: Tensor) -> Tensor:
    return _Sum.apply(values)  # pyright: ignore[reportReturnType] - the stubs do not know what apply returns
