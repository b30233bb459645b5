"""Find Gaussians that are closer to another camera than the near bound.

A Gaussian with a wrong depth can lie just in front of another camera and occlude the whole scene there. Its centre
often projects outside that image, where it cannot be compared with a surface.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.config import ReceiverConfig
from fecocodec.geometry.cameras import Cameras
from fecocodec.receiver.sampling import project


@torch.no_grad()
def near_bound_violation(
    points: Float[Tensor, "3 view h2 w2"], cameras: Cameras, config: ReceiverConfig
) -> Float[Tensor, "view h2 w2"]:
    """Return each Gaussian's strongest violation of the near bound over all other views of the scene, in [0, 1]."""
    strongest, margin = torch.zeros_like(points[0]), config.near_bound_margin
    for judge in range(cameras.num_views):
        others = [view for view in range(cameras.num_views) if view != judge]
        camera = cameras.select([judge])
        uv, depth, _ = project(camera, points[:, others])
        forward = camera.extrinsics[0, :3, 2]
        offset = points[:, others] - camera.extrinsics[0, :3, 3, None, None, None]
        is_in_front = (offset * forward[:, None, None, None]).sum(dim=0) > 0
        is_inside = ((uv > -margin) & (uv < 1 + margin)).all(dim=0)
        excess = (depth / (config.near_bound_depth * camera.near)).log() / config.near_bound_width
        strongest[others] = torch.maximum(strongest[others], is_in_front * is_inside * torch.sigmoid(-excess))
    return strongest
