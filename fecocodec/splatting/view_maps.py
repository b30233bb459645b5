"""Colour, depth and opacity of each view's Gaussians, as maps over its image from which layers are extrapolated."""

from dataclasses import dataclass

import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import SH_DEGREE_0, Gaussians
from fecocodec.splatting.sampling import SMALLEST_DEPTH


@dataclass(frozen=True)
class ViewMaps:
    """Maps over the images; all are 0 for a Gaussian that is not finite or not in front of its camera.

    colour: sRGB in [0, 1]. depth: along the optical axis.
    """

    colour: Float[Tensor, "3 view h w"]
    depth: Float[Tensor, "view h w"]
    opacity: Float[Tensor, "view h w"]


def view_maps(gaussians: Gaussians, cameras: Cameras, grid: tuple[int, int]) -> ViewMaps:
    """Return the maps of Gaussians of degree 0, ordered (view, row, column), with `grid` = (height, width) per view."""
    views = cameras.num_views
    means = rearrange(gaussians.means, "(v h w) xyz -> v h w xyz", v=views, h=grid[0], w=grid[1])
    offset = means - cameras.extrinsics[:, None, None, :3, 3]
    depth = (offset * cameras.extrinsics[:, None, None, :3, 2]).sum(dim=-1)
    is_usable = means.isfinite().all(dim=-1) & (depth > SMALLEST_DEPTH)
    opacity = rearrange(gaussians.opacities, "(v h w) -> v h w", v=views, h=grid[0], w=grid[1])
    harmonics = rearrange(gaussians.harmonics, "(v h w) 1 rgb -> v h w rgb", v=views, h=grid[0], w=grid[1])
    colour = torch.stack((0.5 + SH_DEGREE_0 * harmonics).clamp(0.0, 1.0).unbind(dim=-1))
    return ViewMaps(torch.where(is_usable, colour, 0.0), torch.where(is_usable, depth, 0.0), is_usable * opacity)
