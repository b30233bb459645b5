"""Fewer Gaussians for nearly the same pictures: for whoever wants a smaller file of splats from a stream.

Leaving a Gaussian out costs what it contributes to pictures times how much its colour differs from its neighbours'.
Those grow more opaque for it, so that a surface drawn by many faint Gaussians does not get thinner; then a few gradient
steps mend what pictures still lack (`mending`).
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
from fecocodec.rendering.refit import mended

LARGEST_CHANGE = 2.8e-5  # squared, of every picture drawn: 46 dB; for new views see docs/report.md
MOST_NEARBY = 8
SHARES = tuple(0.05 * number for number in range(1, 15))
MENDABLE = 12.0  # times LARGEST_CHANGE: shares that change pictures by more are not tried, as mending leaves too much
COMPARED = 8  # neighbours whose mean colour a Gaussian's own is compared with
LEAST_DIFFERENCE = 0.04  # of colour: what a Gaussian is worth that looks like its neighbours
HEIRS = 4  # nearest Gaussians kept, which share the contribution of one that is left out
INHERITED = 1.5  # of it, as heirs also cover each other (docs/experiments.md)
MOST_THICKER = 3.0
_LEAST_CONTRIBUTION = 1e-6  # pixels


@torch.no_grad()
def pruned(gaussians: Gaussians, cameras: Cameras, image_size: tuple[int, int]) -> Gaussians:
    """Those that must stay for the pictures at these cameras, and at cameras near them, to stay what they are, in the
    same order and place; opacities, scales and colours are no longer the same.

    The largest of SHARES, cheapest first, whose absence, once mended, changes no picture by more than LARGEST_CHANGE;
    all, unchanged, where there is none. image_size: (height, width).
    """
    if gaussians.count == 0:
        return gaussians
    nearby = nearby_cameras(cameras, MOST_NEARBY)
    seen_from = cameras if nearby is None else _joined(cameras, nearby)
    reference = render(gaussians, seen_from, image_size).color
    weight = contributions(gaussians, seen_from, image_size).amax(dim=0)
    price = weight * (LEAST_DIFFERENCE + _difference_of_colour(gaussians))
    order = price.sort().values
    trials: list[Gaussians] = []
    for share in SHARES:
        fewer = _without(gaussians, weight, price < order[int(share * len(order))])
        if _change(fewer, seen_from, reference) > MENDABLE * LARGEST_CHANGE:
            break
        trials.append(fewer)
    for fewer in reversed(trials):
        found = mended(fewer, seen_from, reference)
        if _change(found, seen_from, reference) <= LARGEST_CHANGE:
            return found
    return gaussians


def _change(gaussians: Gaussians, cameras: Cameras, reference: Float[Tensor, "camera 3 h w"]) -> float:
    """Mean squared difference of the picture that changes most."""
    pictures = render(gaussians, cameras, (reference.shape[-2], reference.shape[-1])).color
    return float((pictures - reference).square().mean(dim=(1, 2, 3)).max())


def _without(gaussians: Gaussians, contribution: Float[Tensor, " n"], left_out: Bool[Tensor, " n"]) -> Gaussians:
    """The others, of which the nearest take over what those left out contribute, in pixels.

    Their optical thickness -ln(1 - opacity) grows in the ratio of what they then contribute to what they did, at most
    MOST_THICKER times.
    """
    kept, gone = gaussians.keep(~left_out), gaussians.keep(left_out)
    if kept.count == 0 or gone.count == 0:
        return kept
    heirs = nearest_neighbours(kept.means, HEIRS, gone.means)
    distance = (kept.means[heirs] - gone.means[:, None]).norm(dim=-1)
    share = 1.0 / distance.clamp_min(1e-6 * distance.mean().clamp_min(1e-30))
    handed = INHERITED * contribution[left_out, None] * share / share.sum(dim=1, keepdim=True)
    inherited = torch.zeros_like(kept.opacities).index_add(0, heirs.flatten(), handed.flatten())
    thicker = 1.0 + inherited / contribution[~left_out].clamp_min(_LEAST_CONTRIBUTION)
    thickness = -torch.log1p(-kept.opacities.clamp(max=0.999)) * thicker.clamp(max=MOST_THICKER)
    return replace(kept, opacities=torch.maximum(kept.opacities, -torch.expm1(-thickness)))


def _difference_of_colour(gaussians: Gaussians) -> Float[Tensor, " n"]:
    """Mean absolute difference, sRGB, between a Gaussian's colour and the mean of its nearest neighbours'."""
    colour = SH_DEGREE_0 * gaussians.harmonics[:, 0]
    neighbours = nearest_neighbours(gaussians.means, COMPARED + 1)[:, 1:]
    return (colour[neighbours].mean(dim=1) - colour).abs().mean(dim=1)


def _joined(first: Cameras, second: Cameras) -> Cameras:
    extrinsics = torch.cat((first.extrinsics, second.extrinsics))
    return Cameras(extrinsics, torch.cat((first.intrinsics, second.intrinsics)), first.near, first.far)
