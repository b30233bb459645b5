"""Project points into a camera and sample maps of its view at their projections.

The Gaussians of a view form a regular grid over its image, so maps of their attributes are sampled without rendering.
"""

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras

SMALLEST_DEPTH = 1e-6  # scenes are normalised to near = 1


def project(
    camera: Cameras, points: Float[Tensor, "3 *grid"]
) -> tuple[Float[Tensor, "2 *grid"], Float[Tensor, "*grid"], Bool[Tensor, "*grid"]]:
    """Project points in the world frame into one camera.

    Returns normalised image positions, depths, and whether each point is inside the image. Points behind the camera get
    depth 1 and are not inside. Coordinates are the first dimension, because it is several times as fast as the last.
    """
    to_camera = camera.world_to_camera[0]
    projection = camera.intrinsics[0] @ to_camera[:3]
    projected = torch.addmm(projection[:, 3:], projection[:, :3], points.flatten(1)).view_as(points)
    depth = projected[2]
    is_in_front = depth > SMALLEST_DEPTH
    depth = torch.where(is_in_front, depth, 1.0)
    uv = projected[:2] / depth
    inside = (uv >= 0) & (uv <= 1)
    return uv, depth, is_in_front & inside[0] & inside[1]


def sample_at(
    values: Float[Tensor, "channel height width"], uv: Float[Tensor, "2 *grid h w"]
) -> Float[Tensor, "channel *grid h w"]:
    """Sample a map of a view bilinearly at normalised image positions; outside the image the border is replicated."""
    positions = (2.0 * uv.clamp(-1, 2) - 1.0).flatten(1, -2)
    sampled = F.grid_sample(values[None], positions.permute(1, 2, 0)[None], padding_mode="border", align_corners=False)
    return sampled.view(len(values), *uv.shape[1:])
