"""Relative disparity: inverse depth, scaled to 0 at far and 1 at near. All networks represent depth in this way."""

from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras


def depth_from_relative_disparity(
    relative: Float[Tensor, "*batch view height width"], cameras: Cameras
) -> Float[Tensor, "*batch view height width"]:
    """Return depth in scene units, at most 2 far; relative disparities below 0 are depths beyond far."""
    farthest = rearrange(1.0 / cameras.far, "... -> ... 1 1 1")
    nearest = rearrange(1.0 / cameras.near, "... -> ... 1 1 1")
    return 1.0 / (farthest + relative * (nearest - farthest)).clamp_min(0.5 * farthest)


def relative_disparity_from_depth(
    depth: Float[Tensor, "*batch view height width"], cameras: Cameras
) -> Float[Tensor, "*batch view height width"]:
    """Invert `depth_from_relative_disparity`, without its clamp. depth: in scene units."""
    farthest = rearrange(1.0 / cameras.far, "... -> ... 1 1 1")
    nearest = rearrange(1.0 / cameras.near, "... -> ... 1 1 1")
    return (1.0 / depth - farthest) / (nearest - farthest)
