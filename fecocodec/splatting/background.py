"""Background layer: blurred Gaussians outside all context views, so that other views show no black areas there.

Its part behind near surfaces, inside the views, is in `splatting/occluded.py`.

The border of each view is extrapolated outwards, with more blur and larger cells at larger distances, on several layers
behind the surface at the border. Only candidates that are visible in no context view are kept (`splatting/hidden.py`),
because the codec optimises colours against a black background and any Gaussian behind them would brighten the context
views. The layer is computed from decoded Gaussians and cameras and needs no bits.
"""

from dataclasses import dataclass, replace

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float, Int64
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.splatting.facing import facing_gaussians, view_maps
from fecocodec.splatting.hidden import is_hidden
from fecocodec.splatting.sampling import SMALLEST_DEPTH

SMALLEST_OPACITY = 0.01  # a border of smaller mean opacity is transparent and not extrapolated


@dataclass(frozen=True)
class BackgroundConfig:
    """Parameters of the background layer. Lengths in the image are fractions of its width (or height)."""

    depth_factors: tuple[float, ...] = (1.1, 1.8, 3.0)  # depth of each layer, relative to the blurred border depth
    reach: float = 1.5  # extent of the layers beyond each border
    gap: float = 0.024  # between the border and the first cell
    first_cell: float = 0.015  # width of the first cell
    cell_growth: float = 1.7  # ratio of the widths of successive cells
    cells_inside: int = 12  # along a side of the image
    blur: float = 0.03  # standard deviation of the blur at the border
    blur_growth: float = 0.25  # growth of the blur per distance from the border


@dataclass(frozen=True)
class _Axis:
    """Cells along one image axis, before 0, in [0, 1] and after 1; centres and widths in normalised image units.

    row, column: of the cells of both axes that are outside the image.
    """

    centres: Float[Tensor, " cell"]
    widths: Float[Tensor, " cell"]
    row: Int64[Tensor, " outside"]
    column: Int64[Tensor, " outside"]

    def outside(self, values: Float[Tensor, "view row column *channel"]) -> Float[Tensor, "view outside *channel"]:
        """Return the values of the cells outside the image."""
        return values.flatten(1, 2).index_select(1, self.row * len(self.centres) + self.column)


DEFAULT_BACKGROUND = BackgroundConfig()


def background_layer(
    gaussians: Gaussians, cameras: Cameras, grid: tuple[int, int], config: BackgroundConfig = DEFAULT_BACKGROUND
) -> Gaussians:
    """Return the background layer as Gaussians with harmonics of degree 0, in the frame of the cameras.

    gaussians: of degree 0, ordered (view, row, column), with `grid` = (height, width) per view; opacity 0 for those
    that are not emitted. cameras: of these views, near = 1; the grids cover their images. A transparent border is not
    extrapolated.
    """
    candidates, extended = background_candidates(gaussians, cameras, grid, config)
    hidden = is_hidden(candidates, extended, cell_centres(config, gaussians.means), cameras)
    return candidates.keep((candidates.opacities > 0.0) & hidden)


def background_candidates(
    gaussians: Gaussians, cameras: Cameras, grid: tuple[int, int], config: BackgroundConfig = DEFAULT_BACKGROUND
) -> tuple[Gaussians, Float[Tensor, "view row column"]]:
    """Return candidates, and the depth of each view at the cells, which decides which of them are hidden.

    The candidates are one Gaussian per layer, view and cell outside the image, facing its view, ordered (layer, view,
    cell). Where the border is transparent, they have an opacity of 0.
    """
    axis = _axis(config, gaussians.means)
    colour, depth, opacity = _extrapolated(gaussians, cameras, grid, axis, config)
    factors = depth.new_tensor(config.depth_factors)
    layers = len(factors)
    candidates = facing_gaussians(
        cameras,
        torch.stack((axis.centres[axis.column], axis.centres[axis.row]), dim=-1),
        torch.stack((axis.widths[axis.column], axis.widths[axis.row]), dim=-1),
        rearrange(factors, "layer -> layer 1 1") * axis.outside(depth),
        axis.outside(colour).expand(layers, -1, -1, -1),
        (axis.outside(opacity) > SMALLEST_OPACITY).expand(layers, -1, -1),
    )
    return candidates, depth


def cell_centres(config: BackgroundConfig, like: Tensor) -> Float[Tensor, " cell"]:
    """Return the centres of the cells along either axis of an image, in normalised image units."""
    return _axis(config, like).centres


def append(gaussians: Gaussians, layer: Gaussians) -> Gaussians:
    """Concatenate Gaussians and a layer of degree 0, whose higher harmonics are set to zero."""
    missing = gaussians.harmonics.shape[-2] - layer.harmonics.shape[-2]
    harmonics = F.pad(layer.harmonics, (0, 0, 0, missing))
    added = (layer.means, layer.scales, layer.rotations, layer.opacities, harmonics)
    return Gaussians(*(torch.cat(fields) for fields in zip(gaussians.fields(), added, strict=True)))


def _axis(config: BackgroundConfig, like: Tensor) -> _Axis:
    """Return uniform cells inside the image and, beyond a gap outside it, cells that grow by a constant ratio."""
    edge, width, distances, widths = config.gap, config.first_cell, [], []
    while edge < config.reach:
        distances.append(edge + 0.5 * width)
        widths.append(width)
        edge, width = edge + width, width * config.cell_growth
    inside = [(cell + 0.5) / config.cells_inside for cell in range(config.cells_inside)]
    centres = [*(-distance for distance in reversed(distances)), *inside, *(1.0 + distance for distance in distances)]
    all_widths = [*reversed(widths), *(1.0 / config.cells_inside for _ in inside), *widths]
    is_beyond = [centre < 0 or centre > 1 for centre in centres]
    cells = range(len(centres))
    outside = [(row, column) for row in cells for column in cells if is_beyond[row] or is_beyond[column]]
    row, column = torch.tensor(outside, device=like.device).T.contiguous()
    return _Axis(like.new_tensor(centres), like.new_tensor(all_widths), row, column)


def _extrapolated(
    gaussians: Gaussians, cameras: Cameras, grid: tuple[int, int], axis: _Axis, config: BackgroundConfig
) -> tuple[Float[Tensor, "view row column 3"], Float[Tensor, "view row column"], Float[Tensor, "view row column"]]:
    """Return sRGB colour and depth of each view at the cells, and the opacity at the nearest point of the image.

    They are blurred means over the view's Gaussians around that point. Colour and depth are weighted by opacity; depth
    is a root mean square, which favours farther surfaces.
    """
    maps = view_maps(gaussians, cameras, grid)
    weight, values = maps.opacity, torch.cat((maps.colour, maps.depth.square()[None]))
    rows, columns = (_blur_weights(axis, side, config) for side in grid)
    total = (rows @ weight @ columns.T).clamp_min(SMALLEST_DEPTH)
    red, green, blue, square = rows @ (values * weight) @ columns.T / total
    rows, columns = (_blur_weights(axis, side, replace(config, blur_growth=0.0)) for side in grid)
    at_border = rows @ weight @ columns.T
    return torch.stack((red, green, blue), dim=-1), square.sqrt().clamp_min(SMALLEST_DEPTH), at_border


def _blur_weights(axis: _Axis, side: int, config: BackgroundConfig) -> Float[Tensor, "cell side"]:
    """Return the weights of pixels along one axis for each cell: a Gaussian around the nearest point of the image."""
    nearest = axis.centres.clamp(0.0, 1.0)
    deviation = (config.blur_growth * (axis.centres - nearest).abs()).clamp_min(config.blur)
    pixels = (torch.arange(side).to(axis.centres) + 0.5) / side
    return torch.softmax(-0.5 * ((pixels - nearest[:, None]) / deviation[:, None]).square(), dim=1)
