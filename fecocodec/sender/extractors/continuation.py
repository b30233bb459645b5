"""Depth where no other view confirms it: the surfaces seen beside it, continued.

A plane's inverse depth is affine in image position, so what is hidden or outside the other views is taken to lie on
the plane of confirmed neighbours of like colour. Fits are weighted by distance, colour and agreement (bilateral, as in
Tomasi and Manduchi, "Bilateral filtering for gray and color images", 1998), and made robust by reweighting.
"""

import math

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

REACH = 0.25  # standard deviation of distance, in sides of a square of the image's area
COLOUR_REACH = 0.05  # of sRGB colours in [0, 1]
RIDGE = 0.005  # of slopes, in REACH^2: holds a plane level where its neighbours lie on a line
OUTLIER = 0.05  # difference of relative disparity at which a neighbour's weight is halved
NUM_FITS = 4
AGREEMENT_POWER = 4  # so that barely confirmed neighbours hardly count
MOST_CELLS = 1024  # or a few more, for whole rows and columns; every cell is fitted to every other
_LEAST_WEIGHT = 1e-8


@torch.no_grad()
def continued(
    relative: Float[Tensor, "item 1 h4 w4"],
    agreement: Float[Tensor, "item 1 h4 w4"],
    images: Float[Tensor, "item 3 h w"],
) -> Float[Tensor, "item 1 h4 w4"]:
    """Relative disparity of the plane fitted around each pixel to the relative disparity that other views agree with.

    In [0, 1]. The fits are made on a coarser grid. No gradient.
    """
    height, width = relative.shape[-2:]
    coarseness = max(2, math.ceil(math.sqrt(height * width / MOST_CELLS)))
    size = (math.ceil(height / coarseness), math.ceil(width / coarseness))
    weight = agreement.float() ** AGREEMENT_POWER + _LEAST_WEIGHT
    pooled = F.adaptive_avg_pool2d(weight, size)
    disparity = F.adaptive_avg_pool2d(relative.float() * weight, size) / pooled
    colour = F.adaptive_avg_pool2d(images.float(), size)
    places = _positions(*size, width / height, relative.device)
    fine = _positions(height, width, width / height, relative.device)
    planes = torch.stack([_planes(places, *item) for item in zip(colour, disparity[:, 0], pooled[:, 0], strict=True)])
    level, right, down = F.interpolate(planes, (height, width), mode="nearest").unbind(dim=1)
    offset = fine - F.interpolate(places[None], (height, width), mode="nearest")[0]
    return (level + right * offset[0] + down * offset[1]).clamp(0.0, 1.0)[:, None]


def _positions(height: int, width: int, aspect: float, device: torch.device) -> Float[Tensor, "xy h w"]:
    """Centres of cells, in sides of a square of the image's area."""
    x = (torch.arange(width, device=device) + 0.5) / width * math.sqrt(aspect)
    y = (torch.arange(height, device=device) + 0.5) / height / math.sqrt(aspect)
    return torch.stack(torch.meshgrid(x, y, indexing="xy"))


def _planes(
    places: Float[Tensor, "xy h w"],
    colour: Float[Tensor, "3 h w"],
    disparity: Float[Tensor, "h w"],
    weight: Float[Tensor, "h w"],
) -> Float[Tensor, "plane h w"]:
    """(disparity at the cell's centre, slope to the right, slope down) of the plane around every cell."""
    position, seen = rearrange(places, "xy h w -> (h w) xy"), rearrange(colour, "c h w -> (h w) c")
    value = disparity.flatten()
    likeness = -torch.cdist(position, position).square() / (2 * REACH**2)
    likeness = likeness - torch.cdist(seen, seen).square() / (2 * COLOUR_REACH**2) + weight.flatten().log()
    x, y = position.unbind(dim=1)
    moments = torch.stack((x, y, value, x * x, x * y, y * y, x * value, y * value), dim=1)
    doubt = torch.zeros_like(value)
    for _ in range(NUM_FITS):
        mean_x, mean_y, mean, xx, xy, yy, xv, yv = ((likeness - doubt).softmax(dim=1) @ moments).unbind(dim=1)
        xx, yy = xx - mean_x * mean_x + RIDGE * REACH**2, yy - mean_y * mean_y + RIDGE * REACH**2
        xy, xv, yv = xy - mean_x * mean_y, xv - mean_x * mean, yv - mean_y * mean
        determinant = xx * yy - xy * xy
        right, down = (yy * xv - xy * yv) / determinant, (xx * yv - xy * xv) / determinant
        level = mean + right * (x - mean_x) + down * (y - mean_y)
        doubt = ((level - value) / OUTLIER).square().log1p()
    return torch.stack((level, right, down)).view(3, *disparity.shape)
