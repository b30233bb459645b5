"""Whether the device named on the command line can be used."""

import torch

from fecocodec.errors import InputError


def require_device(name: str) -> None:
    """Raise InputError before any work where this machine does not have the device `cpu`, `cuda` or `cuda:N`."""
    index = torch.device(name).index or 0
    if name != "cpu" and index >= torch.cuda.device_count():
        raise InputError(
            f"device {name} was asked for, but torch sees {torch.cuda.device_count()} CUDA devices here; "
            "choose another with --device, such as cpu."
        )
