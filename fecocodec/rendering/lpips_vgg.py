"""LPIPS with VGG-16 by its own package `lpips`, which users install themselves, with the weights of its backbone.

Zhang et al., "The Unreasonable Effectiveness of Deep Features as a Perceptual Metric", 2018. Nothing is downloaded.
"""

from functools import lru_cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.errors import InputError

LPIPS_BACKBONE = "vgg16-397923af.pth"  # file name of VGG-16's weights in torchvision


def is_lpips_installed() -> bool:
    """Return whether the package `lpips` and the weights of its backbone are installed."""
    return find_spec("lpips") is not None and _backbone().is_file()


def lpips_vgg(
    images: Float[Tensor, "*batch 3 height width"], targets: Float[Tensor, "*batch 3 height width"]
) -> Float[Tensor, "*batch"]:
    """Return the LPIPS (VGG-16) of each pair, 0 for equal images. images, targets: sRGB in [0, 1].

    Gradients reach the images. Raises InputError if the package or the weights of its backbone are not installed.
    """
    network = _load(str(images.device))
    stacked = (stack.reshape(-1, *stack.shape[-3:]) for stack in (images, targets))
    return network(*stacked, normalize=True).reshape(images.shape[:-3])


@lru_cache(maxsize=2)
@torch.inference_mode(False)
def _load(device: str) -> Any:
    if not is_lpips_installed():
        raise InputError(
            f"LPIPS needs the packages lpips and torchvision, and {_backbone()}; install them, or use ST-LPIPS."
        )
    return import_module("lpips").LPIPS(net="vgg", verbose=False).eval().requires_grad_(False).to(device)


def _backbone() -> Path:
    return Path(torch.hub.get_dir(), "checkpoints", LPIPS_BACKBONE)
