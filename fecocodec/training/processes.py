"""Data-parallel training with several processes. Every function also works in a single process."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch
import torch.distributed as dist
from jaxtyping import UInt8
from torch import Tensor, nn


@contextmanager
def joined_processes(device: str = "cpu") -> Iterator[str]:
    """Join the process group of a launcher such as `torchrun`, if there is one, for the duration of the context.

    Yields the device of this process; with `cuda`, every process of a machine gets its own device.
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
    """Return the rank of this process, from 0."""
    return dist.get_rank() if dist.is_initialized() else 0


def num_processes() -> int:
    """Return the number of processes."""
    return dist.get_world_size() if dist.is_initialized() else 1


def is_first() -> bool:
    """Return whether this is the process of rank 0, which writes files."""
    return process_rank() == 0


def seeded_generator(seed: int) -> torch.Generator:
    """Seed torch's own generator and return another one, each with a state of its own in every process."""
    own = seed * 1000 + process_rank()
    torch.manual_seed(own)
    return torch.Generator().manual_seed(own)


def gather_states(state: UInt8[Tensor, " byte"]) -> list[Tensor]:
    """Gather the state of a random generator from every process, by rank."""
    if not dist.is_initialized():
        return [state]
    states = [torch.empty_like(state) for _ in range(dist.get_world_size())]
    dist.all_gather(states, state)
    return states


def broadcast_from_first(flag: bool) -> bool:
    """Return the flag of the first process in every process, so that all save and stop at the same step."""
    if not dist.is_initialized():
        return flag
    shared = torch.tensor(flag)
    dist.broadcast(shared, 0)
    return bool(shared)


def average_gradients(networks: nn.Module) -> None:
    """Replace gradients by their mean over the processes, in one message; does nothing in a single process.

    A parameter without a gradient in some processes counts as zero there; one without a gradient in all processes stays
    without. Gradients keep their memory layout: torch's fused optimisers on the CPU assume that of the parameter, and
    update the wrong elements otherwise.
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
    """Return the gradients of parameters that have one in any process, in the same order in every process."""
    is_used = torch.tensor([parameter.grad is not None for parameter in parameters], dtype=torch.uint8)
    dist.all_reduce(is_used, dist.ReduceOp.MAX)
    gradients = []
    for parameter, used in zip(parameters, is_used.tolist(), strict=True):
        if used and parameter.grad is None:
            parameter.grad = torch.zeros_like(parameter)
        if parameter.grad is not None:
            gradients.append(parameter.grad)
    return gradients
