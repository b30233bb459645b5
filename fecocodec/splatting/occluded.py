"""Occluded part of the background layer: Gaussians behind near surfaces, so that views from beside show no holes there.

Where a view shows a far surface beside a near one, the far one is continued behind the near one: each cell of 8x8
pixels gets one Gaussian with the blurred depth and colour of the farther surfaces around it. Only Gaussians that are
behind what every view shows are kept. Like the rest of the layer, this part is computed from decoded Gaussians and
cameras and needs no bits.

Near surfaces are not quite opaque, so this part does change the pictures at the context cameras a little. The sender
optimises latents and detail with it.
"""

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.splatting.facing import ViewMaps, facing_gaussians, view_maps
from fecocodec.splatting.hidden import projected
from fecocodec.splatting.sampling import SMALLEST_DEPTH

CELL = 4  # Gaussians along a side of a cell
# Chosen on captures that the weights were not trained on (docs/what_we_learned.md, Receiver).
BLURS = (0.03, 0.08)  # standard deviations of the blur, as fractions of the image's width; the first is preferred
FARNESS = 8.0  # exponent of the depth in the weights of the blur: farther surfaces count
SETBACK = 1.03  # depth of a Gaussian, relative to the blurred depth
LEAST_STEP, MOST_STEP = 1.1, 4.0  # depth of a Gaussian, relative to the surface before it
CLEARANCE = 1.03  # the same for surfaces of other views
LEAST_EMITTED = 0.9  # share of the Gaussians in and around a cell that are emitted; others are cut-outs or holes
SMALLEST_OPACITY = 0.01  # of a Gaussian that counts as a surface
SMALLEST_WEIGHT = 1e-30
LEAST_DISTANCE = 1.0  # from a camera; scenes are normalised to near = 1


def occluded_layer(gaussians: Gaussians, cameras: Cameras, grid: tuple[int, int]) -> Gaussians:
    """Return the occluded part as Gaussians with harmonics of degree 0, in the frame of the cameras.

    gaussians: of degree 0, ordered (view, row, column), with `grid` = (height, width) per view, multiples of 4; opacity
    0 for those that are not emitted. cameras: of these views, near = 1; the grids cover their images.
    """
    candidates, surface = occluded_candidates(gaussians, cameras, grid)
    means, is_hidden = candidates.means.T.contiguous(), candidates.opacities > 0.0
    for of_view in zip(surface, cameras.world_to_camera, cameras.intrinsics, strict=True):
        is_hidden = is_hidden & is_behind(means, *of_view)
    of_blur = is_hidden.view(len(BLURS), -1)
    return candidates.keep((of_blur & (of_blur.cumsum(dim=0) == 1)).flatten())


def occluded_candidates(
    gaussians: Gaussians, cameras: Cameras, grid: tuple[int, int]
) -> tuple[Gaussians, Float[Tensor, "view row column"]]:
    """Return one Gaussian per blur, view and cell, and the depth of each view's surface that decides which are hidden.

    Opacity 0 marks those that are not candidates. Of the hidden candidates of a cell, the first is kept.
    """
    maps = view_maps(gaussians, cameras, grid)
    surface, is_filled = _surface(maps)
    rows, columns = surface.shape[-2:]
    depths, colours, is_used = [], [], []
    for blur in BLURS:
        depth, colour = _continued(maps, rows, columns, blur)
        depths.append(depth.minimum(MOST_STEP * surface).flatten(1))
        colours.append(colour.flatten(2).permute(1, 2, 0))
        is_used.append((is_filled & (depth > LEAST_STEP * surface)).flatten(1))
    centres = _centres(columns, surface).expand(rows, -1), _centres(rows, surface)[:, None].expand(-1, columns)
    uv = torch.stack([of_axis.flatten() for of_axis in centres], dim=-1)
    widths = torch.cat((torch.ones_like(uv[:, :1]) / columns, torch.ones_like(uv[:, :1]) / rows), dim=-1)
    layers = torch.stack(depths), torch.stack(colours), torch.stack(is_used)
    return facing_gaussians(cameras, uv, widths, *layers), surface


def is_behind(
    means: Float[Tensor, "3 n"],
    surface: Float[Tensor, "row column"],
    world_to_camera: Float[Tensor, "4 4"],
    intrinsics: Float[Tensor, "3 3"],
) -> Bool[Tensor, " n"]:
    """Return which points are outside the image of a view or behind its surface, and not near its camera.

    Where the surface is 0, nothing is emitted, so nothing is behind it.
    """
    points, is_in_front, depth, uv = projected(means, world_to_camera, intrinsics)
    rows, columns = surface.shape
    column = (uv[0].clamp(0.0, 1.0) * columns).long().clamp(max=columns - 1)
    row = (uv[1].clamp(0.0, 1.0) * rows).long().clamp(max=rows - 1)
    surface = torch.where(surface > 0.0, CLEARANCE * surface, torch.inf)
    limit = surface.flatten().index_select(0, row * columns + column)
    is_seen = is_in_front & ((uv > 0.0) & (uv < 1.0)).all(dim=0) & (depth < limit)
    is_close = points.square().sum(dim=0) < LEAST_DISTANCE**2
    return ~(is_seen | is_close)


def _surface(maps: ViewMaps) -> tuple[Float[Tensor, "view row column"], Bool[Tensor, "view row column"]]:
    """Return the farthest depth in and beside each cell, and whether nearly all Gaussians there are emitted."""
    is_emitted = maps.opacity > SMALLEST_OPACITY
    depth = F.max_pool2d(torch.where(is_emitted, maps.depth, 0.0)[:, None], CELL + 2, CELL, padding=1)
    share = F.avg_pool2d(is_emitted[:, None].to(depth), CELL + 2, CELL, padding=1, count_include_pad=False)
    return depth[:, 0], share[:, 0] >= LEAST_EMITTED


def _continued(
    maps: ViewMaps, rows: int, columns: int, blur: float
) -> tuple[Float[Tensor, "view row column"], Float[Tensor, "3 view row column"]]:
    """Return depth and colour of the far surfaces around each cell."""
    height, width = maps.depth.shape[-2:]
    along_rows = _blur_weights(rows, height, blur * width / height, maps.depth)
    along_columns = _blur_weights(columns, width, blur, maps.depth)
    farness = (maps.depth / maps.depth.amax(dim=(1, 2), keepdim=True).clamp_min(SMALLEST_DEPTH)) ** FARNESS
    weight = torch.where(maps.opacity > SMALLEST_OPACITY, maps.opacity * farness, 0.0)

    def blurred(values: Tensor) -> Tensor:
        return along_rows @ values @ along_columns.T

    total = blurred(weight).clamp_min(SMALLEST_WEIGHT)
    return SETBACK * blurred(weight * maps.depth) / total, blurred(weight * maps.colour) / total


def _blur_weights(cells: int, side: int, deviation: float, like: Tensor) -> Float[Tensor, "cell side"]:
    """Return the weights of Gaussians along one axis for each cell."""
    distance = _centres(side, like) - _centres(cells, like)[:, None]
    return torch.softmax(-0.5 * (distance / deviation).square(), dim=1)


def _centres(count: int, like: Tensor) -> Float[Tensor, " count"]:
    """Return the centres of `count` equal parts of [0, 1]."""
    return (torch.arange(count, device=like.device).to(like.dtype) + 0.5) / count
