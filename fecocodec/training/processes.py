"""Several processes that train together; each function also serves a process on its own."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch
import torch.distributed as dist
from jaxtyping import UInt8
from torch import Tensor, nn


@contextmanager
def joined_processes(device: str = "cpu") -> Iterator[str]:
    """Join the process group that a launcher such as `torchrun` describes in the environment; alone without one.

    Gives the device of this process: of several that train on `cuda`, each has one of its own.
    """
    if not dist.is_torchelastic_launched():
        yield device
        return
    if device != "cpu":
        device = f"cuda:{dist.get_node_local_rank()}"
        torch.cuda.set_device(device)
    dist.init_process_group("gloo" if device == "cpu" else "cpu:gloo,cuda:nccl")
    try:
        yield device
    finally:
        dist.destroy_process_group()


def process_rank() -> int:
    """The number of this process, from 0."""
    return dist.get_rank() if dist.is_initialized() else 0


def is_first() -> bool:
    """Whether this is the process that writes files."""
    return process_rank() == 0


def gather_states(state: UInt8[Tensor, " byte"]) -> list[Tensor]:
    """The state of a random generator in every process, by rank."""
    if not dist.is_initialized():
        return [state]
    states = [torch.empty_like(state) for _ in range(dist.get_world_size())]
    dist.all_gather(states, state)
    return states


def broadcast_from_first(flag: bool) -> bool:
    """What the first process says: all must save and stop at the same step."""
    if not dist.is_initialized():
        return flag
    told = torch.tensor(flag)
    dist.broadcast(told, 0)
    return bool(told)


def average_gradients(networks: nn.Module) -> None:
    """Replace gradients by their mean over the processes, in one message; does nothing in a single process.

    Batches may differ in shape from process to process. A parameter that a step uses in some processes alone counts as
    zero in the others; one that none uses stays without a gradient. Gradients keep their layout in memory: torch's
    fused optimisers on the CPU take it for granted that it is the parameter's, and scramble the update where it is not.
    """
    if not dist.is_initialized():
        return
    gradients = _gradients_of_any(list(networks.parameters()))
    flat = torch.cat([gradient.reshape(-1) for gradient in gradients])
    dist.all_reduce(flat)
    flat /= dist.get_world_size()
    for gradient, mean in zip(gradients, flat.split([gradient.numel() for gradient in gradients]), strict=True):
        gradient.copy_(mean.view_as(gradient))


def _gradients_of_any(parameters: list[nn.Parameter]) -> list[Tensor]:
    """The gradients of all parameters that have one in some process, in the same order in every process."""
    is_used = torch.tensor([parameter.grad is not None for parameter in parameters], dtype=torch.uint8)
    dist.all_reduce(is_used, dist.ReduceOp.MAX)
    gradients = []
    for parameter, used in zip(parameters, is_used.tolist(), strict=True):
        if used and parameter.grad is None:
            parameter.grad = torch.zeros_like(parameter)
        if parameter.grad is not None:
            gradients.append(parameter.grad)
    return gradients
