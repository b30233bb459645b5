"""What layers behind the surfaces are made of: maps of each view's Gaussians, and flat Gaussians that face a view."""

from dataclasses import dataclass

import torch
from einops import rearrange, repeat
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras, rays_through
from fecocodec.geometry.gaussians import SH_DEGREE_0, Gaussians
from fecocodec.geometry.rotations import quaternion_from_matrix
from fecocodec.splatting.sampling import SMALLEST_DEPTH


@dataclass(frozen=True)
class ViewMaps:
    """Maps over the images; all are 0 for a Gaussian that is not finite or not in front of its camera.

    colour: sRGB in [0, 1]. depth: along the optical axis.
    """

    colour: Float[Tensor, "3 view h w"]
    depth: Float[Tensor, "view h w"]
    opacity: Float[Tensor, "view h w"]


def view_maps(gaussians: Gaussians, cameras: Cameras, grid: tuple[int, int]) -> ViewMaps:
    """Return the maps of Gaussians of degree 0, ordered (view, row, column), with `grid` = (height, width) per view."""
    views = cameras.num_views
    means = rearrange(gaussians.means, "(v h w) xyz -> v h w xyz", v=views, h=grid[0], w=grid[1])
    offset = means - cameras.extrinsics[:, None, None, :3, 3]
    depth = (offset * cameras.extrinsics[:, None, None, :3, 2]).sum(dim=-1)
    is_usable = means.isfinite().all(dim=-1) & (depth > SMALLEST_DEPTH)
    opacity = rearrange(gaussians.opacities, "(v h w) -> v h w", v=views, h=grid[0], w=grid[1])
    harmonics = rearrange(gaussians.harmonics, "(v h w) 1 rgb -> v h w rgb", v=views, h=grid[0], w=grid[1])
    colour = torch.stack((0.5 + SH_DEGREE_0 * harmonics).clamp(0.0, 1.0).unbind(dim=-1))
    return ViewMaps(torch.where(is_usable, colour, 0.0), torch.where(is_usable, depth, 0.0), is_usable * opacity)


CELL_SCALE = 0.6  # standard deviation of a Gaussian, relative to the width of its cell
THICKNESS = 0.3  # standard deviation along the optical axis, relative to the smaller lateral one
OPACITY = 0.95


def facing_gaussians(
    cameras: Cameras,
    centres: Float[Tensor, "cell 2"],
    widths: Float[Tensor, "cell 2"],
    depth: Float[Tensor, "layer view cell"],
    colour: Float[Tensor, "layer view cell 3"],
    is_used: Bool[Tensor, "layer view cell"],
) -> Gaussians:
    """Return one Gaussian of degree 0 per layer, view and cell, in this order; opacity 0 where it is not used.

    centres, widths: of the cells, (horizontal, vertical), in normalised image units. colour: sRGB.
    """
    layers, views, cells = depth.shape
    rays = (rays_through(cameras, centres.expand(views, 1, -1, -1)) @ cameras.extrinsics[:, None, :3, :3].mT)[:, 0]
    means = cameras.extrinsics[:, None, :3, 3] + rays * depth[..., None]
    lateral = widths * CELL_SCALE / cameras.intrinsics.diagonal(dim1=-2, dim2=-1)[:, None, :2]
    shape = torch.cat((lateral, THICKNESS * lateral.amin(dim=-1, keepdim=True)), dim=-1)
    rotations = quaternion_from_matrix(cameras.extrinsics[:, :3, :3])
    return Gaussians(
        means=means.flatten(0, 2),
        scales=(shape * depth[..., None]).flatten(0, 2),
        rotations=repeat(rotations, "v q -> (layer v cell) q", layer=layers, cell=cells),
        opacities=(OPACITY * is_used).flatten(),
        harmonics=((colour - 0.5) / SH_DEGREE_0).flatten(0, 2)[:, None],
    )
