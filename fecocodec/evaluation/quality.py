"""How far images are from photographs, in several metrics."""

from dataclasses import dataclass
from pathlib import Path

import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.evaluation.extras import require_extra
from fecocodec.rendering.metrics import MS_SSIM_LEAST_SIDE, ms_ssim, psnr, ssim

LPIPS_BACKBONE = "alexnet-owt-7be5be79.pth"  # what torchvision calls AlexNet's weights


@dataclass(frozen=True)
class Quality:
    """Means over images. psnr in dB; ssim, ms_ssim: 1 is equal; flip, lpips: 0 is equal.

    ms_ssim: None for sides under 176 pixels. lpips: None where the package or its weights are not installed; no other
    metric stands in for it.
    """

    psnr: float
    ssim: float
    ms_ssim: float | None
    flip: float
    lpips: float | None


@torch.no_grad()
def measure_quality(
    images: Float[Tensor, "image 3 height width"], targets: Float[Tensor, "image 3 height width"]
) -> Quality:
    """Both sRGB in [0, 1]. Raises InputError where a package of the `eval` extra is missing."""
    return Quality(
        psnr=float(psnr(images, targets).mean()),
        ssim=float(ssim(images, targets).mean()),
        ms_ssim=float(ms_ssim(images, targets).mean()) if min(images.shape[-2:]) >= MS_SSIM_LEAST_SIDE else None,
        flip=_flip(images, targets),
        lpips=_lpips(images, targets),
    )


def _flip(images: Tensor, targets: Tensor) -> float:
    """Andersson et al., "FLIP: A Difference Evaluator for Alternating Images", 2020, at 67 pixels per degree."""
    library = require_extra("flip_evaluator", "FLIP")
    pairs = zip(*(rearrange(stack, "i rgb h w -> i h w rgb").numpy() for stack in (targets, images)), strict=True)
    errors = [library.evaluate(target, image, "LDR", applyMagma=False)[1] for target, image in pairs]
    return float(sum(errors) / len(errors))


def _lpips(images: Tensor, targets: Tensor) -> float | None:
    """Zhang et al., "The Unreasonable Effectiveness of Deep Features", 2018, AlexNet; nothing is downloaded."""
    if not Path(torch.hub.get_dir(), "checkpoints", LPIPS_BACKBONE).is_file():
        return None
    library = require_extra("lpips", "LPIPS")
    network = library.LPIPS(net="alex", verbose=False)
    return float(network(images, targets, normalize=True).mean())
