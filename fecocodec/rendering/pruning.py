"""Gaussians that no picture shows, found by drawing: for whoever wants a smaller file of splats from a stream."""

import torch
from jaxtyping import Bool
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.nearby_cameras import nearby_cameras
from fecocodec.rendering.contribution import contributions
from fecocodec.rendering.rasterizer import render

LARGEST_CHANGE = 2.5e-5  # squared, of every picture drawn: 46 dB; new views lost 0.07 dB in the mean (docs/report.md)
MOST_NEARBY = 8
SHARES = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5, 0.6)


@torch.no_grad()
def needed(gaussians: Gaussians, cameras: Cameras, image_size: tuple[int, int]) -> Bool[Tensor, " n"]:
    """Which Gaussians must stay for the pictures at these cameras, and at cameras near them, to stay what they are.

    The largest of SHARES, least contribution first, whose absence changes no picture by more than LARGEST_CHANGE.
    image_size: (height, width).
    """
    nearby = nearby_cameras(cameras, MOST_NEARBY)
    seen_from = cameras if nearby is None else _joined(cameras, nearby)
    reference = render(gaussians, seen_from, image_size).color
    weight = contributions(gaussians, seen_from, image_size).amax(dim=0)
    order = weight.sort().values
    kept = torch.ones_like(weight, dtype=torch.bool)
    for share in SHARES:
        fewer = weight >= order[int(share * len(order))]
        change = (render(gaussians.keep(fewer), seen_from, image_size).color - reference).square()
        if float(change.mean(dim=(1, 2, 3)).max()) > LARGEST_CHANGE:
            break
        kept = fewer
    return kept


def _joined(first: Cameras, second: Cameras) -> Cameras:
    extrinsics = torch.cat((first.extrinsics, second.extrinsics))
    return Cameras(extrinsics, torch.cat((first.intrinsics, second.intrinsics)), first.near, first.far)
