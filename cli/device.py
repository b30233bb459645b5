"""Whether the device named on the command line can be used: asked before any work."""

import torch

from fecocodec.errors import InputError
from fecocodec.rendering.cuda import gsplat_rasterization


def require_device(name: str) -> None:
    """Raise InputError where this machine does not have the device `cpu`, `cuda` or `cuda:N`."""
    index = torch.device(name).index or 0
    if name != "cpu" and index >= torch.cuda.device_count():
        raise InputError(
            f"device {name} was asked for, but torch sees {torch.cuda.device_count()} CUDA devices here; "
            "choose another with --device, such as cpu."
        )


def require_rendering_device(name: str) -> None:
    """`require_device` for work that renders there, which on CUDA devices is done by gsplat."""
    require_device(name)
    if name != "cpu":
        gsplat_rasterization()
