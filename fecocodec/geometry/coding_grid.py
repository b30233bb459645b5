"""The coding grid: the resolution at which the networks process the views; its sides are multiples of 32 pixels."""

import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.limits import grid_side

LEAST_KEPT = 0.9  # of a resampled pixel; one that shows more of what a mask marks is ignored


def grid_size(height: int, width: int) -> tuple[int, int]:
    """Return (height, width) of the coding grid of views of that size in pixels."""
    return grid_side(height), grid_side(width)


def resample_to_grid(
    images: Float[Tensor, "view channel height width"],
) -> Float[Tensor, "view channel grid_h grid_w"]:
    """Resample images or opacities, in [0, 1], to their coding grid, bicubic with antialiasing.

    The grid covers exactly the image, so the normalised intrinsics do not change.
    """
    size = grid_size(images.shape[-2], images.shape[-1])
    if size == tuple(images.shape[-2:]):
        return images
    return F.interpolate(images, size, mode="bicubic", antialias=True, align_corners=False).clamp(0.0, 1.0)


def ignored_on_grid(ignored: Bool[Tensor, "view height width"] | None) -> Bool[Tensor, "view grid_h grid_w"] | None:
    """Return which pixels of the coding grid show what masks mark; None without masks."""
    if ignored is None:
        return None
    kept = F.adaptive_avg_pool2d((~ignored)[:, None].float(), grid_size(ignored.shape[-2], ignored.shape[-1]))
    return kept[:, 0] < LEAST_KEPT
