"""The coding grid: the resolution at which the networks process the views; its sides are multiples of 32 pixels."""

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.grid import grid_side

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


def filled(
    images: Float[Tensor, "view channel height width"], ignored: Bool[Tensor, "view height width"] | None
) -> Float[Tensor, "view channel height width"]:
    """Return images with smooth colours in place of the ignored pixels; black where all of an image is ignored.

    Colours come from the finest level of a pyramid that has any (push-pull: Gortler et al., "The Lumigraph", 1996).
    """
    if ignored is None or not bool(ignored.any()):
        return images
    weight = (~ignored)[:, None].to(images)
    return _filled(images * weight, weight)


def _filled(
    weighted: Float[Tensor, "view channel height width"], weight: Float[Tensor, "view 1 height width"]
) -> Float[Tensor, "view channel height width"]:
    """weighted: colours times their weight."""
    known = weighted / torch.where(weight > 0, weight, 1.0)
    height, width = weight.shape[-2:]
    if bool((weight > 0).all()) or max(height, width) == 1:
        return known
    half = (-(-height // 2), -(-width // 2))
    coarse = _filled(F.adaptive_avg_pool2d(weighted, half), F.adaptive_avg_pool2d(weight, half))
    return torch.where(weight > 0, known, F.interpolate(coarse, (height, width), mode="bilinear"))
