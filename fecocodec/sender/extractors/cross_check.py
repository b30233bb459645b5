"""Whether views confirm each other's depth: points that another view places elsewhere are hidden there, or wrong."""

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.geometry.cameras import Cameras, camera_to_world_points, pixel_rays
from fecocodec.geometry.depth import depth_from_relative_disparity, relative_disparity_from_depth

TOLERANCE = 0.05  # difference of relative disparity at which agreement has fallen to 1/e


@torch.no_grad()
def agreement(
    relative: Float[Tensor, "batch view h w"], cameras: Cameras, sources: Int[Tensor, "batch view count"]
) -> Float[Tensor, "batch view h w"]:
    """exp(-difference / TOLERANCE) between a pixel's own relative disparity, carried over to a source view, and the
    source's where the pixel's point falls; of the source that agrees best. Zero where no source sees the point.

    Points are carried over in 3D, so that cameras may be turned and moved freely against each other. No gradient.
    """
    height, width = relative.shape[-2:]
    depth = depth_from_relative_disparity(relative, cameras)
    points = camera_to_world_points(cameras, pixel_rays(cameras, height, width) * depth[..., None])
    found = torch.zeros_like(relative)
    for scene, views in enumerate(sources.tolist()):
        own = cameras.scene(scene)
        for view, others in enumerate(views):
            for source in others:
                seen = _agreement_with(relative[scene, source], points[scene, view], own, source)
                found[scene, view] = torch.maximum(found[scene, view], seen)
    return found


def _agreement_with(
    relative: Float[Tensor, "h w"], points: Float[Tensor, "h w 3"], cameras: Cameras, source: int
) -> Float[Tensor, "h w"]:
    """Agreement of world points with one source's relative disparity."""
    uv, depth, is_visible = (field[0] for field in cameras.select([source]).project(points))
    grid = 2.0 * uv.clamp(-1, 2)[None] - 1.0
    told = F.grid_sample(relative[None, None], grid, padding_mode="border", align_corners=False)[0, 0]
    depth = torch.where(is_visible, depth, 1.0)
    carried = relative_disparity_from_depth(rearrange(depth, "h w -> 1 h w"), cameras)[0]
    return torch.where(is_visible, torch.exp(-(carried - told).abs() / TOLERANCE), 0.0)
