"""What the codec was trained to make small, for each view: the D of R + D."""

import math

from jaxtyping import Float
from torch import Tensor

from fecocodec.rendering.metrics import ssim

SSIM_WEIGHT = 0.03  # as in training


def distortions(
    renderings: Float[Tensor, "view 3 height width"],
    images: Float[Tensor, "view 3 height width"],
    ssim_stride: int = 1,
) -> Float[Tensor, " view"]:
    """Mean squared error + 0.03 (1 - SSIM) of each view. ssim_stride: see `metrics.ssim`."""
    squared = (renderings - images).square().mean(dim=(1, 2, 3))
    return squared + SSIM_WEIGHT * (1.0 - ssim(renderings.clamp(0, 1), images, ssim_stride))


def mean_psnr(renderings: Float[Tensor, "view 3 height width"], images: Float[Tensor, "view 3 height width"]) -> float:
    """PSNR in dB of all views together, at most 100."""
    return -10.0 * math.log10(max(squared_error(renderings, images), 1e-10))


def squared_error(
    renderings: Float[Tensor, "view 3 height width"], images: Float[Tensor, "view 3 height width"]
) -> float:
    """Mean over all views of the squared error of what a screen shows."""
    return float((renderings.clamp(0, 1) - images).square().mean())
