"""Project points into cameras and sample maps of their views at the projections.

The Gaussians of a view form a regular grid over its image, so maps of their attributes are sampled without rendering.
"""

from collections.abc import Iterator

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from fecocodec.geometry.cameras import Cameras

# One a Gaussian; h and w are twice those of surfaces (h4, w4) where cells have four.
Points = Float[Tensor, "view 3 h w"]  # in the frame of the cameras
Colours = Float[Tensor, "view 3 h w"]  # sRGB
PerGaussian = Float[Tensor, "view h w"]


def other_views(cameras: Cameras, *, fewest: int = 2) -> Iterator[tuple[Int64[Tensor, " view"], Cameras]]:
    """Yield for every shift the index of each view's other view, and the cameras of these other views.

    cameras: of one scene. Yields nothing for fewer views than `fewest`.
    """
    views = cameras.num_views
    for shift in range(1, views if views >= fewest else 1):
        index = (torch.arange(views, device=cameras.extrinsics.device) + shift) % views
        extrinsics, intrinsics = (x.index_select(0, index) for x in (cameras.extrinsics, cameras.intrinsics))
        yield index, Cameras(extrinsics, intrinsics, cameras.near, cameras.far)


SMALLEST_DEPTH = 1e-6  # scenes are normalised to near = 1


def project(
    cameras: Cameras, points: Points
) -> tuple[Float[Tensor, "view 2 h w"], PerGaussian, Bool[Tensor, "view h w"]]:
    """Project points in the world frame, those of entry v into camera v.

    Returns normalised image positions, depths, and whether each point is inside the image. Points behind the camera get
    depth 1 and are not inside. Coordinates precede the grid, because this is several times as fast as the last place.
    """
    projection = cameras.intrinsics @ cameras.world_to_camera[:, :3]
    projected = torch.baddbmm(projection[..., 3:], projection[..., :3], points.flatten(2)).view_as(points)
    depth = projected[:, 2]
    is_in_front = depth > SMALLEST_DEPTH
    depth = torch.where(is_in_front, depth, 1.0)
    uv = projected[:, :2] / depth[:, None]
    inside = (uv >= 0) & (uv <= 1)
    return uv, depth, is_in_front & inside[:, 0] & inside[:, 1]


def sample_at(
    values: Float[Tensor, "view channel height width"], uv: Float[Tensor, "view 2 h w"]
) -> Float[Tensor, "view channel h w"]:
    """Sample maps of views bilinearly at normalised image positions; outside the image the border is replicated."""
    positions = (2.0 * uv.clamp(-1, 2) - 1.0).permute(0, 2, 3, 1)
    return F.grid_sample(values, positions, padding_mode="border", align_corners=False)
