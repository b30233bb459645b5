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
from fecocodec.receiver.view_pairs import cameras_of, others, third_view_shifts


@torch.no_grad()
def near_bound_violation(
    points: Float[Tensor, "view 3 h2 w2"], cameras: Cameras, config: ReceiverConfig
) -> Float[Tensor, "view h2 w2"]:
    """Return each Gaussian's strongest violation of the near bound over all other views of the scene, in [0, 1].

    It is zero for fewer than three views.
    """
    strongest = torch.zeros_like(points[:, 0])
    for shift in third_view_shifts(cameras.num_views):
        strongest = torch.maximum(strongest, near_bound_violation_at(shift, points, cameras, config))
    return strongest


def near_bound_violation_at(
    shift: int | Tensor, points: Float[Tensor, "view 3 h2 w2"], cameras: Cameras, config: ReceiverConfig
) -> Float[Tensor, "view h2 w2"]:
    """Return the violation of the near bound of the view `shift` positions after each Gaussian's own."""
    margin = config.near_bound_margin
    cameras_there = cameras_of(cameras, others(cameras.num_views, shift, points.device))
    uv, depth, _ = project(cameras_there, points)
    forward, centre = cameras_there.extrinsics[:, :3, 2], cameras_there.extrinsics[:, :3, 3]
    offset = points - centre[..., None, None]
    is_in_front = (offset * forward[..., None, None]).sum(dim=1) > 0
    is_inside = ((uv > -margin) & (uv < 1 + margin)).all(dim=1)
    excess = (depth / (config.near_bound_depth * cameras.near)).log() / config.near_bound_width
    return is_in_front * is_inside * torch.sigmoid(-excess)
