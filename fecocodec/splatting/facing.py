"""Gaussians of the background layer: flat ones that fill cells of an image and face its view."""

import torch
from einops import repeat
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras, rays_through
from fecocodec.geometry.gaussians import SH_DEGREE_0, Gaussians
from fecocodec.geometry.rotations import quaternion_from_matrix

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
