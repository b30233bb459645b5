"""Find Gaussians that stand nearer to a camera than the near bound of the scene allows.

A Gaussian that one view predicts badly can come to lie just in front of another camera. Few pixels are enough to hide
the whole scene there, and such a Gaussian often projects outside that image, where its surface cannot be compared.
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
    """Return how far each Gaussian of one scene violates the near bound of any other view, in [0, 1]."""
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
