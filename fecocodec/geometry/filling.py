"""Fill pixels that masks mark from those around them, so that nothing sees what is there, nor an edge."""

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor


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
