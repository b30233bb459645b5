"""Compare Gaussians with the surface that another view shows, and find those that another view confirms."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.config import ReceiverConfig
from fecocodec.geometry.cameras import Cameras
from fecocodec.receiver.sampling import project, sample_at


@dataclass(frozen=True)
class Comparison:
    """Gaussians of some views against the surface that one other view shows at their positions.

    uv: normalised image positions in that view. lead: logarithm of the surface's depth over the Gaussian's, positive
    in front of the surface. squared_difference: of sRGB colours in [0, 1], summed over channels.
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
    """Compare Gaussians with one view's surface: its colour and inverse depth."""
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
    """Return how well the best other view confirms each Gaussian of one scene in colour and depth, in [0, 1]."""
    views = cameras.num_views
    best = torch.zeros_like(points[0])
    for judge in range(views):
        others = [view for view in range(views) if view != judge]
        seen = compare(points[:, others], colour[:, others], surfaces[judge], cameras.select([judge]))
        is_alike = 1.0 / (1.0 + (seen.squared_difference / config.free_space_colour).square())
        agreement = torch.exp(-(seen.lead / config.free_space_lead).square()) * is_alike
        best[others] = torch.maximum(best[others], seen.is_seen * agreement)
    return best
