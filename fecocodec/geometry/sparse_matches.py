"""Points that look alike in two photographs, found without cameras: corners with upright histograms of gradients.

Sources: Shi and Tomasi, "Good features to track", 1994 (corners); Lowe, "Distinctive image features from
scale-invariant keypoints", 2004 (descriptors of 4x4 cells with 8 directions, and the ratio of distances).
"""

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor

CORNER_SIDE = 256  # pixels of the images in which corners are searched
_MOST_CORNERS = 500
_LEAST_CORNER = 1e-6  # smaller eigenvalue of the gradients' mean products, of grey values in [0, 1]
_SEPARATION = 7  # pixels, side of the square in which a corner is the strongest
_CELLS = (-6, -2, 2, 6)  # pixels, centres of the cells of a descriptor
_BORDER = 10  # pixels
_DIRECTIONS = 8
_MOST_OF_A_CELL = 0.2  # of a descriptor of unit length, against single strong edges
_MOST_RATIO = 0.9  # of the angles between a descriptor and its nearest and second nearest


@dataclass(frozen=True)
class Corners:
    """Corners of one photograph. positions: (u, v) in [0, 1]. descriptors: of unit length."""

    positions: Float[Tensor, "corner 2"]
    descriptors: Float[Tensor, "corner value"]


def corners_of(
    images: Float[Tensor, "view 3 height width"], ignored: Bool[Tensor, "view height width"] | None
) -> list[Corners]:
    """Return the corners of each image. ignored: pixels without corners."""
    return [find_corners(image, None if ignored is None else ignored[view]) for view, image in enumerate(images)]


@torch.no_grad()
def find_corners(image: Float[Tensor, "3 height width"], ignored: Bool[Tensor, "height width"] | None) -> Corners:
    """Return the strongest corners of an image. ignored: pixels without corners."""
    grey = small(image.mean(dim=0, keepdim=True))
    rows, columns = torch.gradient(_smoothed(grey, 1), dim=(2, 3))  # down and to the right
    strength = _smaller_eigenvalue(rows, columns)
    if ignored is not None:
        is_ignored = F.interpolate(ignored[None, None].float(), grey.shape[-2:], mode="nearest") > 0
        strength = strength.masked_fill(is_ignored, 0.0)
    inner = strength[..., _BORDER:-_BORDER, _BORDER:-_BORDER]
    is_strongest = F.max_pool2d(inner, _SEPARATION, stride=1, padding=_SEPARATION // 2) == inner
    values, index = (inner * is_strongest).flatten().topk(min(_MOST_CORNERS, inner.numel()))
    index = index[values > _LEAST_CORNER]
    y, x = index // inner.shape[-1] + _BORDER, index % inner.shape[-1] + _BORDER
    cells = _smoothed(_direction_maps(rows, columns), 3)
    values = torch.cat([cells[0, :, y + down, x + right] for down in _CELLS for right in _CELLS]).T
    descriptors = F.normalize(F.normalize(values, dim=1).clamp(max=_MOST_OF_A_CELL), dim=1)
    return Corners((torch.stack((x, y), dim=1) + 0.5) / torch.tensor([grey.shape[-1], grey.shape[-2]]), descriptors)


def small(image: Float[Tensor, "channel height width"]) -> Float[Tensor, "1 channel small_height small_width"]:
    """Return an image at the size at which corners are searched."""
    scale = CORNER_SIDE / max(image.shape[-2:])
    size = [round(side * scale) for side in image.shape[-2:]]
    return F.interpolate(image[None], size, mode="bilinear", antialias=True, align_corners=False)


def match_corners(first: Corners, second: Corners) -> tuple[Float[Tensor, "match 2"], Float[Tensor, "match 2"]]:
    """Return the positions of corners that look alike, see `alike`."""
    one, other = alike(first, second)
    return first.positions[one], second.positions[other]


def alike(first: Corners, second: Corners) -> tuple[Int[Tensor, " match"], Int[Tensor, " match"]]:
    """Return the indices of corners that are each other's nearest, and clearly nearer than the next one."""
    none = torch.zeros(0, dtype=torch.long)
    if min(len(first.positions), len(second.positions)) < 2:
        return none, none
    angles = torch.acos((first.descriptors @ second.descriptors.T).clamp(-1, 1))
    nearest, index = angles.topk(2, dim=1, largest=False)
    is_mutual = angles.argmin(dim=0)[index[:, 0]] == torch.arange(len(angles))
    is_match = is_mutual & (nearest[:, 0] < _MOST_RATIO * nearest[:, 1])
    return is_match.nonzero()[:, 0], index[is_match, 0]


def _smaller_eigenvalue(rows: Float[Tensor, "1 1 h w"], columns: Float[Tensor, "1 1 h w"]) -> Float[Tensor, "1 1 h w"]:
    """Return the smaller eigenvalue of the mean products of gradients around each pixel."""
    products = _smoothed(torch.cat((rows * rows, columns * columns, rows * columns), dim=1), 2)
    down, right, mixed = products.split(1, dim=1)
    return (down + right) / 2 - ((down - right).square() / 4 + mixed.square()).sqrt()


def _direction_maps(
    rows: Float[Tensor, "1 1 h w"], columns: Float[Tensor, "1 1 h w"]
) -> Float[Tensor, "1 direction h w"]:
    """Return the length of each gradient, shared between the two nearest of _DIRECTIONS directions."""
    position = torch.atan2(rows, columns) * (_DIRECTIONS / (2 * math.pi)) % _DIRECTIONS
    directions = torch.arange(float(_DIRECTIONS))[:, None, None]
    distance = ((position - directions + _DIRECTIONS / 2) % _DIRECTIONS - _DIRECTIONS / 2).abs()
    return torch.hypot(rows, columns) * (1 - distance).clamp_min(0)


def _smoothed(maps: Float[Tensor, "1 channel h w"], radius: int) -> Float[Tensor, "1 channel h w"]:
    """Return the maps after two means over squares, each of the side 2 `radius` + 1."""
    side = 2 * radius + 1
    for window in 2 * ((1, side), (side, 1)):
        padding = (window[0] // 2, window[1] // 2)
        maps = F.avg_pool2d(maps, window, stride=1, padding=padding, count_include_pad=False)
    return maps
