"""Plane extrapolation: estimate depth where no other view confirms it, from confirmed pixels nearby.

The inverse depth of a plane is affine in the image position. Pixels that are occluded in, or outside of, all other
views are assumed to lie on the plane of confirmed neighbours of similar colour. The weights of the fit depend on
distance, colour and consistency (bilateral, as in Tomasi and Manduchi, "Bilateral filtering for gray and color images",
1998); iterative reweighting makes it robust.
"""

import math

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

REACH = 0.25  # standard deviation of the distance weight; unit: side of a square with the area of the image
COLOUR_REACH = 0.05  # standard deviation of the colour weight, sRGB in [0, 1]
RIDGE = 0.005  # ridge regularisation of the slopes, in REACH^2, for neighbours that are almost collinear
OUTLIER = 0.05  # residual, in relative disparity, at which the robust weight is 1/2
NUM_FITS = 4  # iterations of reweighting
CONSISTENCY_POWER = 4  # exponent of the consistency in the weight; suppresses barely confirmed pixels
MOST_CELLS = 1024  # of the fitting grid, approximately; every cell is fitted to all cells
_LEAST_WEIGHT = 1e-8


@torch.no_grad()
def extrapolate_planes(
    relative: Float[Tensor, "item 1 h4 w4"],
    consistency: Float[Tensor, "item 1 h4 w4"],
    images: Float[Tensor, "item 3 h w"],
) -> Float[Tensor, "item 1 h4 w4"]:
    """Return the relative disparity, in [0, 1], of planes fitted to the confirmed relative disparity around each pixel.

    relative: relative disparity in [0, 1]. consistency: cross-view consistency in [0, 1]. images: sRGB in [0, 1]. The
    planes are fitted on a coarser grid. The result has no gradient.
    """
    height, width = relative.shape[-2:]
    coarseness = max(2, math.ceil(math.sqrt(height * width / MOST_CELLS)))
    size = (math.ceil(height / coarseness), math.ceil(width / coarseness))
    weight = consistency.float() ** CONSISTENCY_POWER + _LEAST_WEIGHT
    pooled = F.adaptive_avg_pool2d(weight, size)
    disparity = F.adaptive_avg_pool2d(relative.float() * weight, size) / pooled
    colour = F.adaptive_avg_pool2d(images.float(), size)
    centres = _positions(*size, width / height, relative.device)
    fine = _positions(height, width, width / height, relative.device)
    planes = torch.stack([_planes(centres, *item) for item in zip(colour, disparity[:, 0], pooled[:, 0], strict=True)])
    level, right, down = F.interpolate(planes, (height, width), mode="nearest").unbind(dim=1)
    offset = fine - F.interpolate(centres[None], (height, width), mode="nearest")[0]
    return (level + right * offset[0] + down * offset[1]).clamp(0.0, 1.0)[:, None]


def _positions(height: int, width: int, aspect: float, device: torch.device) -> Float[Tensor, "xy h w"]:
    """Return (x, y) of the cell centres; unit: side of a square with the area of the image."""
    x = (torch.arange(width, device=device) + 0.5) / width * math.sqrt(aspect)
    y = (torch.arange(height, device=device) + 0.5) / height / math.sqrt(aspect)
    return torch.stack(torch.meshgrid(x, y, indexing="xy"))


def _planes(
    centres: Float[Tensor, "xy h w"],
    colour: Float[Tensor, "3 h w"],
    disparity: Float[Tensor, "h w"],
    weight: Float[Tensor, "h w"],
) -> Float[Tensor, "plane h w"]:
    """Fit a plane around every cell. Returns (disparity at the cell centre, slope in x, slope in y)."""
    position, colours = rearrange(centres, "xy h w -> (h w) xy"), rearrange(colour, "c h w -> (h w) c")
    value = disparity.flatten()
    log_weight = -torch.cdist(position, position).square() / (2 * REACH**2)
    log_weight = log_weight - torch.cdist(colours, colours).square() / (2 * COLOUR_REACH**2) + weight.flatten().log()
    x, y = position.unbind(dim=1)
    moments = torch.stack((x, y, value, x * x, x * y, y * y, x * value, y * value), dim=1)
    penalty = torch.zeros_like(value)  # of outliers, subtracted from the log weight
    for _ in range(NUM_FITS):
        mean_x, mean_y, mean, xx, xy, yy, xv, yv = ((log_weight - penalty).softmax(dim=1) @ moments).unbind(dim=1)
        xx, yy = xx - mean_x * mean_x + RIDGE * REACH**2, yy - mean_y * mean_y + RIDGE * REACH**2
        xy, xv, yv = xy - mean_x * mean_y, xv - mean_x * mean, yv - mean_y * mean
        determinant = xx * yy - xy * xy
        right, down = (yy * xv - xy * yv) / determinant, (xx * yv - xy * xv) / determinant
        level = mean + right * (x - mean_x) + down * (y - mean_y)
        penalty = ((level - value) / OUTLIER).square().log1p()
    return torch.stack((level, right, down)).view(3, *disparity.shape)
