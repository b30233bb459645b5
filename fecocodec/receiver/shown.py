"""What each view shows, told by its own Gaussians: each was placed on one of its pixels, nothing need be rendered."""

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras

SMALLEST_DEPTH = 1e-6  # scenes are normalised to near = 1


def seen_by(
    camera: Cameras, places: Float[Tensor, "3 *grid"]
) -> tuple[Float[Tensor, "2 *grid"], Float[Tensor, "*grid"], Bool[Tensor, "*grid"]]:
    """Where one camera sees points of its world: normalised image positions, depths, and whether it sees them.

    Points behind the camera get depth 1 and are not seen. Coordinates come first, each a map of its own: side by side
    in memory they take several times as long.
    """
    to_camera = camera.world_to_camera[0]
    projection = camera.intrinsics[0] @ to_camera[:3]
    projected = torch.addmm(projection[:, 3:], projection[:, :3], places.flatten(1)).view_as(places)
    depth = projected[2]
    is_in_front = depth > SMALLEST_DEPTH
    depth = torch.where(is_in_front, depth, 1.0)
    uv = projected[:2] / depth
    inside = (uv >= 0) & (uv <= 1)
    return uv, depth, is_in_front & inside[0] & inside[1]


def shown_at(
    shown: Float[Tensor, "channel height width"], uv: Float[Tensor, "2 *grid h w"]
) -> Float[Tensor, "channel *grid h w"]:
    """What a view shows at normalised image positions, bilinear; at its border where they lie beyond it."""
    positions = (2.0 * uv.clamp(-1, 2) - 1.0).flatten(1, -2)
    there = F.grid_sample(shown[None], positions.permute(1, 2, 0)[None], padding_mode="border", align_corners=False)
    return there.view(len(shown), *uv.shape[1:])
