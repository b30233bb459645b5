"""Image quality in several metrics."""

from dataclasses import dataclass

import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.evaluation.extras import require_extra
from fecocodec.rendering.lpips_vgg import is_lpips_installed, lpips_vgg
from fecocodec.rendering.metrics import MS_SSIM_LEAST_SIDE, ms_ssim, psnr, ssim
from fecocodec.rendering.perceptual import ST_LPIPS_LEAST_SIDE, st_lpips


@dataclass(frozen=True)
class Quality:
    """Means over images. psnr in dB; ssim and ms_ssim are 1, flip, st_lpips and lpips are 0 for identical images.

    ms_ssim: None if a side is shorter than 176 pixels. st_lpips: with AlexNet, None if a side is shorter than 21
    pixels. lpips: with VGG-16, None if its package or the weights of its backbone are not installed.
    """

    psnr: float
    ssim: float
    ms_ssim: float | None
    flip: float
    st_lpips: float | None
    lpips: float | None


@torch.no_grad()
def measure_quality(
    images: Float[Tensor, "image 3 height width"], targets: Float[Tensor, "image 3 height width"]
) -> Quality:
    """Measure the quality of images. images, targets: sRGB in [0, 1].

    Raises InputError if a package of the `eval` extra is missing.
    """
    return Quality(
        psnr=float(psnr(images, targets).mean()),
        ssim=float(ssim(images, targets).mean()),
        ms_ssim=float(ms_ssim(images, targets).mean()) if min(images.shape[-2:]) >= MS_SSIM_LEAST_SIDE else None,
        flip=_flip(images, targets),
        st_lpips=float(st_lpips(images, targets).mean()) if min(images.shape[-2:]) >= ST_LPIPS_LEAST_SIDE else None,
        lpips=float(lpips_vgg(images, targets).mean()) if is_lpips_installed() else None,
    )


def _flip(images: Tensor, targets: Tensor) -> float:
    """Andersson et al., "FLIP: A Difference Evaluator for Alternating Images", 2020, at 67 pixels per degree."""
    library = require_extra("flip_evaluator", "FLIP")
    pairs = zip(*(rearrange(stack, "i rgb h w -> i h w rgb").numpy() for stack in (targets, images)), strict=True)
    errors = [library.evaluate(target, image, "LDR", applyMagma=False)[1] for target, image in pairs]
    return float(sum(errors) / len(errors))
