"""Compare Gaussians with the surfaces of other views, and measure how well other views confirm them."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.config import ReceiverConfig
from fecocodec.geometry.cameras import Cameras
from fecocodec.receiver.sampling import project, sample_at


@dataclass(frozen=True)
class Comparison:
    """Gaussians compared with the surface of one other view at the positions where they project.

    uv: normalised image positions in that view. lead: logarithm of the surface depth over the Gaussian's depth,
    positive in front of the surface. squared_difference: of sRGB colours in [0, 1], summed over channels. is_seen:
    whether the Gaussian projects inside the image.
    """

    uv: Float[Tensor, "2 other h2 w2"]
    lead: Float[Tensor, "other h2 w2"]
    squared_difference: Float[Tensor, "other h2 w2"]
    is_seen: Bool[Tensor, "other h2 w2"]


def compare(
    points: Float[Tensor, "3 other h2 w2"],
    colour: Float[Tensor, "3 other h2 w2"],
    surface: Float[Tensor, "4 h4 w4"],
    camera: Cameras,
) -> Comparison:
    """Compare Gaussians with the surface of one view. surface: sRGB colour and inverse depth."""
    uv, depth, is_seen = project(camera, points)
    there = sample_at(surface, uv)
    lead = -(there[3] * depth).clamp_min(1e-6).log()
    return Comparison(uv, lead, (there[:3] - colour).square().sum(dim=0), is_seen)


def confirmation(
    points: Float[Tensor, "3 view h2 w2"],
    colour: Float[Tensor, "3 view h2 w2"],
    surfaces: Float[Tensor, "view 4 h4 w4"],
    cameras: Cameras,
    config: ReceiverConfig,
) -> Float[Tensor, "view h2 w2"]:
    """Return the confirmation of each Gaussian of one scene by other views, in [0, 1].

    It is exp(-(lead / L)^2) / (1 + (squared colour difference / D)^2), the maximum over the other views that see the
    Gaussian (FORMAT.md, section 9.1).
    """
    views = cameras.num_views
    best = torch.zeros_like(points[0])
    for judge in range(views):
        others = [view for view in range(views) if view != judge]
        seen = compare(points[:, others], colour[:, others], surfaces[judge], cameras.select([judge]))
        is_alike = 1.0 / (1.0 + (seen.squared_difference / config.free_space_colour).square())
        agreement = torch.exp(-(seen.lead / config.free_space_lead).square()) * is_alike
        best[others] = torch.maximum(best[others], seen.is_seen * agreement)
    return best
