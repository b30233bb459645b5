"""Cross-view consistency of depth maps: low for points that are occluded in the other views, or have a wrong depth."""

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.geometry.cameras import (
    Cameras,
    camera_to_world_points,
    depth_from_relative_disparity,
    pixel_rays,
    relative_disparity_from_depth,
)

TOLERANCE = 0.05  # difference of relative disparity at which the consistency is 1/e


@torch.no_grad()
def cross_view_consistency(
    relative: Float[Tensor, "batch view h w"],
    cameras: Cameras,
    sources: Int[Tensor, "batch view count"],
    kept: Float[Tensor, "batch view h w"] | None = None,
) -> Float[Tensor, "batch view h w"]:
    """Return the cross-view consistency of each pixel, in [0, 1]: the maximum of exp(-difference / TOLERANCE) over the
    source views. Zero if no source sees the point.

    The 3D point of the pixel is projected into a source view. The difference is that between the relative disparity of
    the projected point and the relative disparity of the source at this position. relative: in [0, 1]. sources:
    indices of the source views of each view. kept: share of each pixel that no mask marks, in [0, 1], by which its
    consistency, and that with it, is multiplied; None without masks. The result has no gradient.
    """
    height, width = relative.shape[-2:]
    depth = depth_from_relative_disparity(relative, cameras)
    points = camera_to_world_points(cameras, pixel_rays(cameras, height, width) * depth[..., None])
    consistency = torch.zeros_like(relative)
    for scene, views in enumerate(sources.tolist()):
        own = cameras.scene(scene)
        for view, others in enumerate(views):
            for source in others:
                known = None if kept is None else kept[scene, source]
                candidate = consistency_with(relative[scene, source], points[scene, view], own, source, known)
                consistency[scene, view] = torch.maximum(consistency[scene, view], candidate)
    return consistency if kept is None else consistency * kept


def consistency_with(
    relative: Float[Tensor, "h w"],
    points: Float[Tensor, "h w 3"],
    cameras: Cameras,
    source: int,
    kept: Float[Tensor, "h w"] | None = None,
) -> Float[Tensor, "h w"]:
    """Return the consistency of world points with the relative disparity of one source view.

    kept: share of its pixels that no mask marks; None without masks.
    """
    uv, depth, is_visible = (field[0] for field in cameras.select([source]).project(points))
    grid = 2.0 * uv.clamp(-1, 2)[None] - 1.0
    sampled = F.grid_sample(relative[None, None], grid, padding_mode="border", align_corners=False)[0, 0]
    depth = torch.where(is_visible, depth, 1.0)
    projected = relative_disparity_from_depth(rearrange(depth, "h w -> 1 h w"), cameras)[0]
    consistency = torch.where(is_visible, torch.exp(-(projected - sampled).abs() / TOLERANCE), 0.0)
    if kept is None:
        return consistency
    return consistency * F.grid_sample(kept[None, None], grid, padding_mode="border", align_corners=False)[0, 0]
