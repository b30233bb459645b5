"""Free-space check: find Gaussians in front of another view's surface that differ from it in colour.

Depth that only one view determines is uncertain, and a Gaussian that is too near occludes the surfaces of other views.
A real surface in front of another view's surface would be visible in that view (Curless and Levoy, "A volumetric method
for building complex models from range images", 1996).

With three or more views, a Gaussian is confirmed if its colour and depth are consistent with another view. Confirmed
Gaussians are protected from violations against surfaces that are not confirmed. Gaussians of a view with less
confirmation than the other view are rejected at a smaller colour difference. Gaussians closer to another camera than
the near bound are rejected regardless of colour. FORMAT.md, section 9.1, has the formulas.
"""

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.config import ReceiverConfig
from fecocodec.geometry.cameras import Cameras
from fecocodec.receiver.confirmation import Comparison, compare, confirmation
from fecocodec.receiver.near_bound import near_bound_violation
from fecocodec.receiver.sampling import sample_at

POOLED = 2  # side of the blocks of Gaussians that are averaged to a view's surface


@torch.no_grad()
def free_space_violation(
    means: Float[Tensor, "batch view h2 w2 3"],
    depth: Float[Tensor, "batch view h2 w2"],
    colour: Float[Tensor, "batch view h2 w2 3"],
    opacity: Float[Tensor, "batch view h2 w2"],
    cameras: Cameras,
    config: ReceiverConfig,
) -> Float[Tensor, "batch view h2 w2"]:
    """Return the strongest free-space violation of each Gaussian over all other views, in [0, 1]; no gradient.

    means: in the frame of the cameras. depth: in the Gaussian's own view, in scene units. colour: sRGB. h2 and w2 must
    be even.
    """
    if cameras.num_views == 1:
        return torch.zeros_like(depth)
    points, colour = (rearrange(x, "b v h w c -> b c v h w").contiguous() for x in (means, colour))
    surfaces = _surfaces(depth, colour, opacity)
    scenes = zip(points, colour, surfaces, strict=True)
    return torch.stack([_violation(*scene, cameras.scene(index), config) for index, scene in enumerate(scenes)])


def _surfaces(
    depth: Float[Tensor, "batch view h2 w2"],
    colour: Float[Tensor, "batch 3 view h2 w2"],
    opacity: Float[Tensor, "batch view h2 w2"],
) -> Float[Tensor, "batch view 4 h4 w4"]:
    """Return each view's surface: colour and inverse depth of its Gaussians, averaged over blocks, opacity-weighted."""
    values = torch.cat((colour, 1.0 / depth[:, None], torch.ones_like(depth)[:, None]), dim=1)
    weighted = rearrange(values * (opacity[:, None] + 1e-3), "b c v h w -> (b v) c h w")
    pooled = rearrange(F.avg_pool2d(weighted, POOLED), "(b v) c h w -> b v c h w", b=len(depth))
    return pooled[:, :, :4] / pooled[:, :, 4:]


def _violation(
    points: Float[Tensor, "3 view h2 w2"],
    colour: Float[Tensor, "3 view h2 w2"],
    surfaces: Float[Tensor, "view 4 h4 w4"],
    cameras: Cameras,
    config: ReceiverConfig,
) -> Float[Tensor, "view h2 w2"]:
    """Return the strongest violation of each Gaussian of one scene."""
    views = cameras.num_views
    has_third_views = views > 2
    strongest = near_bound_violation(points, cameras, config) if has_third_views else torch.zeros_like(points[0])
    confirmed = torch.zeros_like(strongest)
    if has_third_views:
        confirmed = confirmation(points, colour, surfaces, cameras, config)
    share = confirmed.mean(dim=(1, 2))
    pooled = F.avg_pool2d(confirmed[:, None], POOLED)
    for judge in range(views):
        others = [view for view in range(views) if view != judge]
        seen = compare(points[:, others], colour[:, others], surfaces[judge], cameras.select([judge]))
        tolerance = torch.full_like(share[others], config.free_space_colour)
        if has_third_views:
            tolerance = (
                tolerance
                * (share[others] / share[judge].clamp_min(1e-6)).clamp(max=1.0) ** config.free_space_strictness
            )
        violation = _in_front(seen, tolerance, config)
        if has_third_views:
            surface = sample_at(pooled[judge], seen.uv)[0]
            violation = violation * (1.0 - config.free_space_protection * confirmed[others] * (1.0 - surface))
        strongest[others] = torch.maximum(strongest[others], violation)
    return strongest


def _in_front(
    seen: Comparison, tolerance: Float[Tensor, " other"], config: ReceiverConfig
) -> Float[Tensor, "other h2 w2"]:
    """Return the violation from position and colour, without confirmation."""
    nearer = torch.sigmoid((seen.lead - config.free_space_lead) / config.free_space_lead_width)
    difference = seen.squared_difference.square()
    return seen.is_seen * nearer * difference / (difference + tolerance.square()[:, None, None]).clamp_min(1e-20)
