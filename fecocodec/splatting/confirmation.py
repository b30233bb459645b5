"""Compare Gaussians with the surfaces of other views, and measure how well other views confirm them."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.config import ReceiverConfig
from fecocodec.geometry.cameras import Cameras
from fecocodec.splatting.sampling import Colours, PerGaussian, Points, other_views, project, sample_at

Surfaces = Float[Tensor, "view 4 h4 w4"]  # sRGB colour and inverse depth, see `free_space.surfaces_of`


@dataclass(frozen=True)
class Comparison:
    """Gaussians compared with the surfaces of other views at the positions where they project.

    lead: logarithm of the surface depth over the Gaussian's depth, positive in front of the surface.
    squared_difference: of sRGB colours in [0, 1], summed over channels. surface: sampled values of the other view.
    is_seen: whether the Gaussian projects inside the image.
    """

    lead: PerGaussian
    squared_difference: PerGaussian
    surface: Float[Tensor, "view channel h w"]
    is_seen: Bool[Tensor, "view h w"]


def compare(
    points: Points, colour: Colours, surfaces: Float[Tensor, "view channel h4 w4"], cameras: Cameras
) -> Comparison:
    """Compare the Gaussians of each view with the surface of another view.

    surfaces, cameras: of the other views. The first four channels are sRGB colour and inverse depth.
    """
    uv, depth, is_seen = project(cameras, points)
    there = sample_at(surfaces, uv)
    lead = -(there[:, 3] * depth).clamp_min(1e-6).log()
    return Comparison(lead, (there[:, :3] - colour).square().sum(dim=1), there, is_seen)


def confirmation(
    points: Points, colour: Colours, surfaces: Surfaces, cameras: Cameras, config: ReceiverConfig
) -> PerGaussian:
    """Return the confirmation of each Gaussian of one scene by other views, in [0, 1]; zero for fewer than three views.

    It is exp(-(lead / L)^2) / (1 + (squared colour difference / D)^2), the maximum over the other views that see the
    Gaussian (FORMAT.md, section 9.1).
    """
    best = torch.zeros_like(points[:, 0])
    for index, there in other_views(cameras, fewest=3):
        best = torch.maximum(best, confirmation_by(points, colour, surfaces.index_select(0, index), there, config))
    return best


def confirmation_by(
    points: Points, colour: Colours, surfaces: Surfaces, cameras: Cameras, config: ReceiverConfig
) -> PerGaussian:
    """Return the confirmation of each Gaussian by another view. surfaces, cameras: of the other views."""
    seen = compare(points, colour, surfaces, cameras)
    is_alike = 1.0 / (1.0 + (seen.squared_difference / config.free_space_colour).square())
    consistency = torch.exp(-(seen.lead / config.free_space_lead).square()) * is_alike
    return seen.is_seen * consistency
