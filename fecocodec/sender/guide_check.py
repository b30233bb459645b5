"""Check guides against the context views before they teach: do they show the same scene, with the same exposure?

Points of the context views, at their matched depth, are projected into each guide. Where the guide shows them, its
colours are compared. A gain and an offset per colour, by matched mean and deviation, absorb exposure and white balance;
a guide in which few points have their colour then has another scene, moving objects all over, or a wrong camera.
"""

from dataclasses import dataclass, replace

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras, camera_to_world_points, depth_from_relative_disparity, pixel_rays
from fecocodec.sender.extractors.protocol import MatchedDepth
from fecocodec.sender.scene import Guides

# Chosen on guides of validation scenes as they are, of other scenes, with turned cameras, and with another exposure.
LEAST_CONSISTENCY = 0.5  # of a matched point that is compared
LEAST_POINTS = 64  # fewer say nothing
SAME_COLOUR = 0.1  # largest mean absolute difference of sRGB
LEAST_AGREEMENT = 0.35  # share of points with the same colour, of a guide that is used
GAINS, OFFSETS = (0.5, 2.0), (-0.25, 0.25)
LEAST_SHIFT, LEAST_STRETCH = 0.05, 0.2  # of middle grey, and of the contrast; occlusions cause smaller ones, too
ROUNDS = 3  # of fit and selection


@dataclass(frozen=True)
class GuideCheck:
    """Result for one guide. agreement: share of points with the same colour; None if too few points are shared.

    gain, offset: guide = gain * context + offset, per colour.
    """

    agreement: float | None
    gain: Float[Tensor, "3"]
    offset: Float[Tensor, "3"]

    @property
    def is_confirmed(self) -> bool:
        """Whether matching shows that the guide has the same scene and a correct camera."""
        return self.agreement is not None and self.agreement >= LEAST_AGREEMENT

    def adapted(self, image: Float[Tensor, "3 h w"]) -> Float[Tensor, "3 h w"]:
        """Return the image with the exposure of the context views, unless it nearly has it."""
        shift = (0.5 * self.gain + self.offset - 0.5).abs()
        if not bool((shift > LEAST_SHIFT).any() or ((self.gain - 1).abs() > LEAST_STRETCH).any()):
            return image
        return ((image - self.offset[:, None, None]) / self.gain[:, None, None]).clamp(0, 1)


@torch.no_grad()
def check_guides(
    images: Float[Tensor, "view 3 h w"], matched: MatchedDepth, cameras: Cameras, guides: Guides
) -> tuple[GuideCheck, ...]:
    """Return the check of each guide. images, matched, cameras: of the context views of one scene, normalised."""
    height, width = matched.relative_disparity.shape[-2:]
    depth = depth_from_relative_disparity(matched.relative_disparity[:, 0][None], cameras.as_batch())[0]
    points = camera_to_world_points(cameras, pixel_rays(cameras, height, width) * depth[..., None])
    is_known = matched.consistency[:, 0] > LEAST_CONSISTENCY
    colours = F.interpolate(images, (height, width), mode="area").movedim(1, -1)[is_known]
    projected = guides.cameras.project(points[is_known])
    shown = F.interpolate(guides.images, (height, width), mode="area")
    grids, is_visible = 2.0 * projected.uv.clamp(-1, 2)[:, None] - 1.0, projected.is_visible
    if guides.ignored is not None:
        covered = F.grid_sample(guides.ignored[:, None].float(), grids, padding_mode="border", align_corners=False)
        is_visible = is_visible & (covered[:, 0, 0] == 0)
    found = F.grid_sample(shown, grids, padding_mode="border", align_corners=False)[:, :, 0].movedim(1, -1)
    return tuple(
        _compare(colours[is_shared], of_guide[is_shared]) for of_guide, is_shared in zip(found, is_visible, strict=True)
    )


def confirmed_guides(guides: Guides, checks: tuple[GuideCheck, ...]) -> Guides | None:
    """Return the guides that are confirmed, with the exposure of the context views; None if none is."""
    kept = [number for number, check in enumerate(checks) if check.is_confirmed]
    if not kept:
        return None
    images = [checks[number].adapted(guides.images[number]) for number in kept]
    return replace(guides.select(kept), images=torch.stack(images))


def reason_of(check: GuideCheck) -> str:
    """Return why a guide is not confirmed, as the end of a sentence."""
    if check.agreement is None:
        return "it shows hardly any point whose depth the coded views know"
    return (
        f"{100 * check.agreement:.0f}% of the points that it shares with the coded views have their colour there; "
        "its camera is wrong, or it shows something else"
    )


def _compare(context: Float[Tensor, "n 3"], guide: Float[Tensor, "n 3"]) -> GuideCheck:
    gain, offset = torch.ones(3).to(context), torch.zeros(3).to(context)
    if len(context) < LEAST_POINTS:
        return GuideCheck(None, gain, offset)
    error = torch.zeros(len(context)).to(context)
    for _ in range(ROUNDS):
        is_like = error <= error.quantile(0.7)
        one, other = context[is_like], guide[is_like]
        gain = (other.std(dim=0) / one.std(dim=0).clamp_min(1e-3)).clamp(*GAINS)
        offset = (other.mean(dim=0) - gain * one.mean(dim=0)).clamp(*OFFSETS)
        error = (guide - gain * context - offset).abs().mean(dim=-1)
    return GuideCheck(float((error < SAME_COLOUR).float().mean()), gain, offset)
