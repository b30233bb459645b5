"""Gaussians that contradict another view: in front of what it shows there, and of another colour.

Where only one view sees a place its depth is a guess, and a guess too near stands in other views' way. A real surface
in front of another view's would be seen by that view, too (free space, as in Curless and Levoy, "A volumetric method
for building complex models from range images", 1996).
"""

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.config import ReceiverConfig
from fecocodec.geometry.cameras import Cameras
from fecocodec.receiver.shown import seen_by, shown_at

POOLED = 2  # Gaussians a side whose mean says what a view shows


@torch.no_grad()
def contradiction(
    means: Float[Tensor, "batch view h2 w2 3"],
    depth: Float[Tensor, "batch view h2 w2"],
    colour: Float[Tensor, "batch view h2 w2 3"],
    opacity: Float[Tensor, "batch view h2 w2"],
    cameras: Cameras,
    config: ReceiverConfig,
) -> Float[Tensor, "batch view h2 w2"]:
    """How far the view that contradicts each Gaussian most does so, in [0, 1]; no gradient.

    means in the cameras' world, depth in the Gaussian's own view, both in scene units; sides even.
    """
    found, views = torch.zeros_like(depth), cameras.num_views
    if views == 1:
        return found
    places, colour = (rearrange(x, "b v h w c -> b c v h w").contiguous() for x in (means, colour))
    shown = _shown(depth, colour, opacity)
    for scene in range(len(depth)):
        for other in range(views):
            judged = [view for view in range(views) if view != other]
            camera = cameras.scene(scene).select([other])
            said = _said_by(shown[scene, other], camera, places[scene][:, judged], colour[scene][:, judged], config)
            found[scene, judged] = torch.maximum(found[scene, judged], said)
    return found


def _shown(
    depth: Float[Tensor, "batch view h2 w2"],
    colour: Float[Tensor, "batch 3 view h2 w2"],
    opacity: Float[Tensor, "batch view h2 w2"],
) -> Float[Tensor, "batch view 4 h4 w4"]:
    """Colour and inverse depth of each view's own Gaussians, mean over `POOLED`x`POOLED` weighted by opacity."""
    values = torch.cat((colour, 1.0 / depth[:, None], torch.ones_like(depth)[:, None]), dim=1)
    weighted = rearrange(values * (opacity[:, None] + 1e-3), "b c v h w -> (b v) c h w")
    pooled = rearrange(F.avg_pool2d(weighted, POOLED), "(b v) c h w -> b v c h w", b=len(depth))
    return pooled[:, :, :4] / pooled[:, :, 4:]


def _said_by(
    shown: Float[Tensor, "4 h4 w4"],
    camera: Cameras,
    places: Float[Tensor, "3 judged h2 w2"],
    colour: Float[Tensor, "3 judged h2 w2"],
    config: ReceiverConfig,
) -> Float[Tensor, "judged h2 w2"]:
    """What one view says of other views' Gaussians; nothing where it does not see them."""
    uv, depth, is_seen = seen_by(camera, places)
    there = shown_at(shown, uv)
    difference = (there[:3] - colour).square().sum(dim=0).square()
    lead = -(there[3] * depth).clamp_min(1e-6).log()
    nearer = torch.sigmoid((lead - config.contradicting_lead) / config.contradicting_lead_width)
    return is_seen * nearer * difference / (difference + config.contradicting_colour**2)
