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
from fecocodec.splatting.confirmation import Surfaces, compare, confirmation
from fecocodec.splatting.sampling import Colours, PerGaussian, Points, other_views, project

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
    points, colour = (rearrange(x, "b v h w c -> b v c h w").contiguous() for x in (means, colour))
    surfaces = surfaces_of(depth, colour, opacity)
    scenes = zip(points, colour, surfaces, strict=True)
    return torch.stack([_violation(*scene, cameras.scene(index), config) for index, scene in enumerate(scenes)])


def surfaces_of(
    depth: Float[Tensor, "batch view h2 w2"],
    colour: Float[Tensor, "batch view 3 h2 w2"],
    opacity: Float[Tensor, "batch view h2 w2"],
) -> Float[Tensor, "batch view 4 h4 w4"]:
    """Return each view's surface: colour and inverse depth of its Gaussians, averaged over blocks, opacity-weighted."""
    values = torch.cat((colour, 1.0 / depth[:, :, None], torch.ones_like(depth)[:, :, None]), dim=2)
    weighted = (values * (opacity[:, :, None] + 1e-3)).flatten(0, 1)
    pooled = F.avg_pool2d(weighted, POOLED).unflatten(0, depth.shape[:2])
    return pooled[:, :, :4] / pooled[:, :, 4:]


def _violation(
    points: Points, colour: Colours, surfaces: Surfaces, cameras: Cameras, config: ReceiverConfig
) -> PerGaussian:
    """Return the strongest violation of each Gaussian of one scene. With two views, the near bound does not count."""
    confirmed = confirmation(points, colour, surfaces, cameras, config)
    share = confirmed.mean(dim=(1, 2)) if cameras.num_views > 2 else torch.ones_like(confirmed[:, 0, 0])
    confirmed_surfaces, strongest = with_confirmation(surfaces, confirmed), torch.zeros_like(confirmed)
    for index, there in other_views(cameras):
        of_others = confirmed_surfaces.index_select(0, index), share.index_select(0, index), there
        strongest = torch.maximum(strongest, violation_by(points, colour, confirmed, share, *of_others, config))
        if cameras.num_views > 2:
            strongest = torch.maximum(strongest, near_bound_violation_by(points, there, config))
    return strongest


def with_confirmation(surfaces: Surfaces, confirmed: PerGaussian) -> Float[Tensor, "view 5 h4 w4"]:
    """Append the confirmation of the Gaussians, averaged over blocks, to the surfaces."""
    return torch.cat((surfaces, F.avg_pool2d(confirmed[:, None], POOLED)), dim=1)


def violation_by(
    points: Points,
    colour: Colours,
    confirmed: PerGaussian,
    share: Float[Tensor, " view"],
    surfaces: Float[Tensor, "view 5 h4 w4"],
    share_there: Float[Tensor, " view"],
    cameras: Cameras,
    config: ReceiverConfig,
) -> PerGaussian:
    """Return the violation of each Gaussian against the surface of another view.

    confirmed: of the Gaussians. share: mean confirmation of their view; 1 for fewer than three views. surfaces,
    share_there, cameras: of the other views; surfaces of `with_confirmation`.
    """
    seen = compare(points, colour, surfaces, cameras)
    ratio = (share / share_there.clamp_min(1e-6)).clamp(max=1.0) ** config.free_space_strictness
    tolerance = config.free_space_colour * ratio
    protection = config.free_space_protection * confirmed * (1.0 - seen.surface[:, 4])
    nearer = torch.sigmoid((seen.lead - config.free_space_lead) / config.free_space_lead_width)
    difference = seen.squared_difference.square()
    bound = (difference + tolerance.square()[:, None, None]).clamp_min(1e-20)
    return seen.is_seen * nearer * difference / bound * (1.0 - protection)


def near_bound_violation_by(points: Points, cameras: Cameras, config: ReceiverConfig) -> PerGaussian:
    """Return the violation of the near bound of another view. cameras: of the other views."""
    margin = config.near_bound_margin
    uv, depth, _ = project(cameras, points)
    forward, centre = cameras.extrinsics[:, :3, 2], cameras.extrinsics[:, :3, 3]
    offset = points - centre[..., None, None]
    is_in_front = (offset * forward[..., None, None]).sum(dim=1) > 0
    is_inside = ((uv > -margin) & (uv < 1 + margin)).all(dim=1)
    excess = (depth / (config.near_bound_depth * cameras.near)).log() / config.near_bound_width
    return is_in_front * is_inside * torch.sigmoid(-excess)
