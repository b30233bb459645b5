"""Fade Gaussians of surfaces that another view shows more finely, with three or more views.

Every view places Gaussians on every surface that it sees. Those of a view far from a surface are larger and less exact
than those of a view near to it, and blur what these show. FORMAT.md, section 9.1, has the formula.
"""

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.config import ReceiverConfig
from fecocodec.geometry.cameras import Cameras
from fecocodec.splatting.confirmation import Surfaces
from fecocodec.splatting.free_space import POOLED, surfaces_of
from fecocodec.splatting.sampling import PerGaussian, Points, other_views, project, sample_at


@torch.no_grad()
def kept_share(
    means: Float[Tensor, "batch view h2 w2 3"],
    depth: Float[Tensor, "batch view h2 w2"],
    colour: Float[Tensor, "batch view h2 w2 3"],
    opacity: Float[Tensor, "batch view h2 w2"],
    opacity_after: Float[Tensor, "batch view h2 w2"],
    cameras: Cameras,
    config: ReceiverConfig,
) -> Float[Tensor, "batch view h2 w2"]:
    """Return the share of its opacity that each Gaussian keeps, in [0, 1]; 1 for fewer than three views. No gradient.

    opacity, opacity_after: before and after the free-space check. Other arguments: see `free_space_violation`.
    """
    kept = torch.ones_like(opacity)
    points, colour = (rearrange(x, "b v h w c -> b v c h w").contiguous() for x in (means, colour))
    for scene, surfaces in enumerate(surfaces_of(depth, colour, opacity)):
        shown, of_scene = shown_surfaces(surfaces, opacity_after[scene]), cameras.scene(scene)
        for index, there in other_views(of_scene, fewest=3):
            beside = kept_beside(points[scene], of_scene, shown.index_select(0, index), there, config)
            kept[scene] = kept[scene] * beside
    return kept


def shown_surfaces(surfaces: Surfaces, opacity: PerGaussian) -> Float[Tensor, "view 2 h4 w4"]:
    """Return inverse depth and opacity of each view's surface.

    surfaces: of `surfaces_of`. opacity: of Gaussians, after the free-space check.
    """
    return torch.cat((surfaces[:, 3:], F.avg_pool2d(opacity[:, None], POOLED)), dim=1)


def kept_beside(
    points: Points,
    cameras: Cameras,
    shown: Float[Tensor, "view 2 h4 w4"],
    cameras_there: Cameras,
    config: ReceiverConfig,
) -> PerGaussian:
    """Return the share that each Gaussian keeps beside another view. shown: `shown_surfaces` of the other views."""
    uv, depth, is_seen = project(cameras_there, points)
    own_depth = project(cameras, points)[1]
    inverse_depth, opacity_there = sample_at(shown, uv).unbind(dim=1)
    lead = (inverse_depth * depth).clamp_min(1e-6).log()
    is_on_surface = is_seen * torch.exp(-(lead / config.duplicate_lead).square())
    sizes = (own_depth / cameras.intrinsics[:, 0, 0, None, None], depth / cameras_there.intrinsics[:, 0, 0, None, None])
    ratio = (sizes[0] / sizes[1]).clamp_min(1e-6).log()
    return 1.0 - is_on_surface * torch.sigmoid(ratio / config.duplicate_width) * opacity_there
