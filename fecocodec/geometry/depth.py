"""Relative disparity: where an inverse depth lies between 1/far (0) and 1/near (1). Networks see nothing but this."""

from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras


def depth_from_relative_disparity(
    relative: Float[Tensor, "*batch view height width"], cameras: Cameras
) -> Float[Tensor, "*batch view height width"]:
    """Depth in scene units; relative disparity below 0 lies behind `far`, down to half of 1/far."""
    farthest = rearrange(1.0 / cameras.far, "... -> ... 1 1 1")
    nearest = rearrange(1.0 / cameras.near, "... -> ... 1 1 1")
    return 1.0 / (farthest + relative * (nearest - farthest)).clamp_min(0.5 * farthest)


def relative_disparity_from_depth(
    depth: Float[Tensor, "*batch view height width"], cameras: Cameras
) -> Float[Tensor, "*batch view height width"]:
    """Inverse of `depth_from_relative_disparity`, not clamped."""
    farthest = rearrange(1.0 / cameras.far, "... -> ... 1 1 1")
    nearest = rearrange(1.0 / cameras.near, "... -> ... 1 1 1")
    return (1.0 / depth - farthest) / (nearest - farthest)
