"""Memory layout of the weights of convolutions."""

import torch
from torch import nn

from fecocodec.errors import InputError


def to_channels_last(network: nn.Module, device: str) -> None:
    """Move a network to a device, in place, and lay out the weights of its 2D convolutions with channels last.

    device: "cpu", "cuda" or "cuda:N". Convolutions on channels-last maps then need no conversion. Raises InputError for
    a device that this machine does not have.
    """
    network.to(usable_device(device))
    for module in network.modules():
        if isinstance(module, nn.Conv2d):
            module.weight.data = module.weight.data.contiguous(memory_format=torch.channels_last)


def usable_device(name: str) -> torch.device:
    """Return a device by its name: "cpu", "cuda" or "cuda:N". Raises InputError if torch does not have it here."""
    try:
        device = torch.device(name)
    except RuntimeError as error:
        raise InputError(f"there is no device '{name}'; choose `cpu`, `cuda` or `cuda:N` by `device`.") from error
    if device.type == "cuda" and (device.index or 0) >= torch.cuda.device_count():
        raise InputError(
            f"device {name} was asked for, but torch sees {torch.cuda.device_count()} CUDA devices here; "
            "choose another by `device`, such as cpu."
        )
    return device
