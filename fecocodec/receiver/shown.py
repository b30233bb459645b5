"""What each view shows, told by its own Gaussians: each was placed on one of its pixels, nothing need be rendered."""

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras

SMALLEST_DEPTH = 1e-6  # scenes are normalised to near = 1


def seen_by(
    camera: Cameras, means: Float[Tensor, "*grid 3"]
) -> tuple[Float[Tensor, "*grid 2"], Float[Tensor, "*grid"], Bool[Tensor, "*grid"]]:
    """Where one camera sees points of its world: normalised image positions, depths, and whether it sees them.

    Points behind the camera get depth 1 and are not seen.
    """
    to_camera = camera.world_to_camera[0]
    projection = camera.intrinsics[0] @ to_camera[:3]
    projected = means @ projection[:, :3].T + projection[:, 3]
    depth = projected[..., 2]
    is_in_front = depth > SMALLEST_DEPTH
    depth = torch.where(is_in_front, depth, 1.0)
    uv = projected[..., :2] / depth[..., None]
    return uv, depth, is_in_front & ((uv >= 0) & (uv <= 1)).all(dim=-1)


def shown_at(
    shown: Float[Tensor, "channel height width"], uv: Float[Tensor, "grid h w 2"]
) -> Float[Tensor, "grid h w channel"]:
    """What a view shows at normalised image positions, bilinear; at its border where they lie beyond it."""
    positions = rearrange(2.0 * uv.clamp(-1, 2) - 1.0, "grid h w xy -> 1 (grid h) w xy")
    there = F.grid_sample(shown[None], positions, padding_mode="border", align_corners=False)
    return rearrange(there, "1 c (grid h) w -> grid h w c", grid=len(uv))
