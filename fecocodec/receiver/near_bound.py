"""Find Gaussians that stand nearer to a camera than the near bound of the scene allows.

A Gaussian that one view predicts badly can come to lie just in front of another camera. Few pixels are enough to hide
the whole scene there, and such a Gaussian often projects outside that image, where its surface cannot be compared.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.receiver.sampling import project

# These belong into ReceiverConfig when its weights are next written.
LEAST_DEPTH = 0.7  # of the near bound: depth at which a Gaussian is rejected by half
LEAST_DEPTH_WIDTH = 0.05  # of the logarithm of depth
MARGIN = 0.5  # of the image's sides, around the image


@torch.no_grad()
def near_bound_violation(points: Float[Tensor, "3 view h2 w2"], cameras: Cameras) -> Float[Tensor, "view h2 w2"]:
    """Return how far each Gaussian of one scene violates the near bound of any other view, in [0, 1]."""
    strongest = torch.zeros_like(points[0])
    for judge in range(cameras.num_views):
        others = [view for view in range(cameras.num_views) if view != judge]
        camera = cameras.select([judge])
        uv, depth, _ = project(camera, points[:, others])
        forward = camera.extrinsics[0, :3, 2]
        offset = points[:, others] - camera.extrinsics[0, :3, 3, None, None, None]
        is_in_front = (offset * forward[:, None, None, None]).sum(dim=0) > 0
        is_inside = ((uv > -MARGIN) & (uv < 1 + MARGIN)).all(dim=0)
        excess = (depth / (LEAST_DEPTH * camera.near)).log() / LEAST_DEPTH_WIDTH
        strongest[others] = torch.maximum(strongest[others], is_in_front * is_inside * torch.sigmoid(-excess))
    return strongest
