"""Where a network's weights lie in memory."""

import torch
from torch import nn


def place(network: nn.Module, device: str) -> None:
    """Move a network to a device, its convolutions' weights laid out with channels last, which runs faster."""
    network.to(device)
    for module in network.modules():
        if isinstance(module, nn.Conv2d):
            module.weight.data = module.weight.data.contiguous(memory_format=torch.channels_last)
