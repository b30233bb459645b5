"""Memory layout of the weights of convolutions."""

import torch
from torch import nn


def to_channels_last(network: nn.Module, device: str) -> None:
    """Move a network to a device, in place, and lay out the weights of its 2D convolutions with channels last.

    device: as torch names it, such as `cpu` or `cuda:0`. Convolutions on channels-last maps then need no conversion.
    """
    network.to(device)
    for module in network.modules():
        if isinstance(module, nn.Conv2d):
            module.weight.data = module.weight.data.contiguous(memory_format=torch.channels_last)
