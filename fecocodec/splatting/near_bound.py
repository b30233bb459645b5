"""Find Gaussians that are closer to another camera than the near bound.

A Gaussian with a wrong depth can lie just in front of another camera and occlude the whole scene there. Its centre
often projects outside that image, where it cannot be compared with a surface.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.config import ReceiverConfig
from fecocodec.geometry.cameras import Cameras
from fecocodec.splatting.sampling import project
from fecocodec.splatting.view_pairs import other_views


@torch.no_grad()
def near_bound_violation(
    points: Float[Tensor, "view 3 h2 w2"], cameras: Cameras, config: ReceiverConfig
) -> Float[Tensor, "view h2 w2"]:
    """Return each Gaussian's strongest violation of the near bound over all other views of the scene, in [0, 1].

    It is zero for fewer than three views.
    """
    strongest = torch.zeros_like(points[:, 0])
    for _, there in other_views(cameras, fewest=3):
        strongest = torch.maximum(strongest, near_bound_violation_by(points, there, config))
    return strongest


def near_bound_violation_by(
    points: Float[Tensor, "view 3 h2 w2"], cameras: Cameras, config: ReceiverConfig
) -> Float[Tensor, "view h2 w2"]:
    """Return the violation of the near bound of another view. cameras: of the other views."""
    margin = config.near_bound_margin
    uv, depth, _ = project(cameras, points)
    forward, centre = cameras.extrinsics[:, :3, 2], cameras.extrinsics[:, :3, 3]
    offset = points - centre[..., None, None]
    is_in_front = (offset * forward[..., None, None]).sum(dim=1) > 0
    is_inside = ((uv > -margin) & (uv < 1 + margin)).all(dim=1)
    excess = (depth / (config.near_bound_depth * cameras.near)).log() / config.near_bound_width
    return is_in_front * is_inside * torch.sigmoid(-excess)
