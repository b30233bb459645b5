"""Prune Gaussians with little contribution and refit the rest.

The cost of removing a Gaussian is its contribution to rendered images times the difference of its colour from its
neighbours'. The opacity of the neighbours grows in compensation, because many faint Gaussians together draw a surface;
a few gradient steps then reduce the remaining error (`refit`).
"""

from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import SH_DEGREE_0, Gaussians
from fecocodec.geometry.nearby_cameras import nearby_cameras
from fecocodec.geometry.neighbours import nearest_neighbours
from fecocodec.rendering.contribution import contributions
from fecocodec.rendering.rasterizer import render
from fecocodec.rendering.refit import refit

LARGEST_CHANGE = (
    2.8e-5  # mean squared error allowed in every rendered image: 46 dB; docs/report.md has the loss at target views
)
MOST_NEARBY = 8
SHARES = tuple(0.05 * number for number in range(1, 15))
MOST_BEFORE_REFIT = 12.0  # times LARGEST_CHANGE: a share that changes images by more before refitting is not tried
COMPARED = 8  # neighbours with whose mean colour a Gaussian is compared
LEAST_DIFFERENCE = 0.04  # added to the colour difference, so that equal colours do not make the cost 0
NUM_SUBSTITUTES = 4  # nearest kept Gaussians, which take over the contribution of a removed one
OVERLAP_FACTOR = 1.5  # on the contribution taken over, because substitutes also cover each other
MOST_THICKER = 3.0
_LEAST_CONTRIBUTION = 1e-6  # pixels


@torch.no_grad()
def prune(gaussians: Gaussians, cameras: Cameras, image_size: tuple[int, int]) -> Gaussians:
    """Remove the Gaussians of least cost and refit the others; returns them in the same order and at the same means.

    The number removed is the largest of SHARES for which, after refitting, no image rendered at these cameras, or at
    cameras near them, changes by more than LARGEST_CHANGE. Opacities, scales and harmonics change. Returns the input
    where no share meets the bound. image_size: (height, width).
    """
    if gaussians.count == 0:
        return gaussians
    nearby = nearby_cameras(cameras, MOST_NEARBY)
    seen_from = cameras if nearby is None else _joined(cameras, nearby)
    reference = render(gaussians, seen_from, image_size).color
    weight = contributions(gaussians, seen_from, image_size).amax(dim=0)
    cost = weight * (LEAST_DIFFERENCE + _difference_of_colour(gaussians))
    order = cost.sort().values
    trials: list[Gaussians] = []
    for share in SHARES:
        fewer = _without(gaussians, weight, cost < order[int(share * len(order))])
        if _change(fewer, seen_from, reference) > MOST_BEFORE_REFIT * LARGEST_CHANGE:
            break
        trials.append(fewer)
    for fewer in reversed(trials):
        refitted = refit(fewer, seen_from, reference)
        if _change(refitted, seen_from, reference) <= LARGEST_CHANGE:
            return refitted
    return gaussians


def _change(gaussians: Gaussians, cameras: Cameras, reference: Float[Tensor, "camera 3 h w"]) -> float:
    """Return the mean squared difference of the image that changes most."""
    images = render(gaussians, cameras, (reference.shape[-2], reference.shape[-1])).color
    return float((images - reference).square().mean(dim=(1, 2, 3)).max())


def _without(gaussians: Gaussians, contribution: Float[Tensor, " n"], is_removed: Bool[Tensor, " n"]) -> Gaussians:
    """Return the Gaussians that are not removed; the nearest of them take over the contribution of the removed ones.

    contribution: in pixels. The optical thickness -ln(1 - opacity) of a substitute grows by the ratio of its new
    contribution to its own, at most MOST_THICKER times.
    """
    kept, removed = gaussians.keep(~is_removed), gaussians.keep(is_removed)
    if kept.count == 0 or removed.count == 0:
        return kept
    substitutes = nearest_neighbours(kept.means, NUM_SUBSTITUTES, removed.means)
    distance = (kept.means[substitutes] - removed.means[:, None]).norm(dim=-1)
    share = 1.0 / distance.clamp_min(1e-6 * distance.mean().clamp_min(1e-30))
    transferred = OVERLAP_FACTOR * contribution[is_removed, None] * share / share.sum(dim=1, keepdim=True)
    received = torch.zeros_like(kept.opacities).index_add(0, substitutes.flatten(), transferred.flatten())
    thicker = 1.0 + received / contribution[~is_removed].clamp_min(_LEAST_CONTRIBUTION)
    thickness = -torch.log1p(-kept.opacities.clamp(max=0.999)) * thicker.clamp(max=MOST_THICKER)
    return replace(kept, opacities=torch.maximum(kept.opacities, -torch.expm1(-thickness)))


def _difference_of_colour(gaussians: Gaussians) -> Float[Tensor, " n"]:
    """Return the mean absolute sRGB difference between each Gaussian's colour and the mean of its neighbours."""
    colour = SH_DEGREE_0 * gaussians.harmonics[:, 0]
    neighbours = nearest_neighbours(gaussians.means, COMPARED + 1)[:, 1:]
    return (colour[neighbours].mean(dim=1) - colour).abs().mean(dim=1)


def _joined(first: Cameras, second: Cameras) -> Cameras:
    extrinsics = torch.cat((first.extrinsics, second.extrinsics))
    return Cameras(extrinsics, torch.cat((first.intrinsics, second.intrinsics)), first.near, first.far)
