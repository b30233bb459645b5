"""Attributes of Gaussians from the raw outputs of the predictor's head, and their bounds."""

from dataclasses import dataclass, fields

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras, camera_to_world_points, depth_from_relative_disparity, rays_through
from fecocodec.geometry.gaussians import SH_DEGREE_0, Gaussians
from fecocodec.geometry.harmonics import LINEAR, QUADRATIC, rotated_harmonics
from fecocodec.geometry.rotations import multiply, quaternion_from_matrix

LARGEST_OFFSET_CELLS = 1.0  # largest offset of a Gaussian from the centre of its cell, in cells of the 1/2 grid
LARGEST_DISPARITY_STEP = 0.08  # largest difference of a Gaussian's relative disparity from that of its cell
LARGEST_LOG_SCALE = 2.5  # scales lie within a factor exp(+-2.5) of 0.67 footprints
RAW = {"opacity": 1, "offset": 2, "disparity": 1, "scale": 3, "rotation": 4, "colour": 3}  # head outputs a Gaussian
# Factor of the raw coefficient above degree 0: 0.1 * 0.25^degree, as in DepthSplat. Their outputs follow those of RAW.
HARMONICS_SHARES = (0.025,) * 3 + (0.00625,) * 5


@dataclass(frozen=True)
class Attributes:
    """Attributes of Gaussians on their grid, in the frame of the cameras.

    scales, rotations, opacity: as in `Gaussians`. colour: sRGB, of degree 0. depth: in the Gaussian's own view, in
    scene units. higher: coefficients of the harmonics above degree 0, none for constant colours.
    """

    means: Float[Tensor, "batch view height width 3"]
    scales: Float[Tensor, "batch view height width 3"]
    rotations: Float[Tensor, "batch view height width 4"]
    opacity: Float[Tensor, "batch view height width"]
    colour: Float[Tensor, "batch view height width 3"]
    depth: Float[Tensor, "batch view height width"]
    higher: Float[Tensor, "batch view height width rest 3"]

    def scene(self, index: int) -> "Attributes":
        return Attributes(*(getattr(self, entry.name)[index : index + 1] for entry in fields(self)))

    def gaussians(self) -> Gaussians:
        """Return the Gaussians of each scene, ordered (view, row, column)."""
        colour = rearrange((self.colour - 0.5) / SH_DEGREE_0, "b v h w rgb -> b (v h w) 1 rgb")
        higher = rearrange(self.higher, "b v h w rest rgb -> b (v h w) rest rgb")
        return Gaussians(
            means=rearrange(self.means, "b v h w xyz -> b (v h w) xyz"),
            scales=rearrange(self.scales, "b v h w xyz -> b (v h w) xyz"),
            rotations=rearrange(self.rotations, "b v h w q -> b (v h w) q"),
            opacities=rearrange(self.opacity, "b v h w -> b (v h w)"),
            harmonics=torch.cat((colour, higher), dim=2),
        )


def activate(
    raw: Float[Tensor, "batch view height width raw"], relative: Float[Tensor, "batch view h4 w4"], cameras: Cameras
) -> Attributes:
    """Convert raw outputs of the head, on the grid of the Gaussians, to bounded attributes, in float32.

    relative: relative disparity on the 1/4 grid.
    """
    height, width = raw.shape[2:4]
    known, higher = raw[..., : sum(RAW.values())], raw[..., sum(RAW.values()) :]
    opacity, offset, disparity, scale, rotation, colour = known.split([*RAW.values()], dim=-1)
    fine = F.interpolate(relative, size=(height, width), mode="bilinear", align_corners=False)
    depth = depth_from_relative_disparity(fine + LARGEST_DISPARITY_STEP * torch.tanh(disparity[..., 0]), cameras)
    rays = rays_through(cameras, _cell_positions(raw, height, width) + _offset_uv(offset, height, width))
    # Width of a cell of this grid at this depth, in scene units.
    footprint = depth / (cameras.intrinsics[..., 0, 0, None, None] * width)
    scales = footprint[..., None] * torch.exp(LARGEST_LOG_SCALE * torch.tanh(scale / LARGEST_LOG_SCALE) - 0.4)
    identity = raw.new_tensor([1.0, 0.0, 0.0, 0.0])
    local = F.normalize(rotation + identity, dim=-1)
    view_to_world = quaternion_from_matrix(cameras.extrinsics[..., :3, :3])[..., None, None, :]
    colour, opacity = torch.sigmoid(2.0 * colour), torch.sigmoid(opacity[..., 0] + 2.0)
    means = camera_to_world_points(cameras, rays * depth[..., None])
    return Attributes(
        means, scales, multiply(view_to_world, local), opacity, colour, depth, _harmonics_in_world(higher, cameras)
    )


def _harmonics_in_world(
    raw: Float[Tensor, "batch view height width raw"], cameras: Cameras
) -> Float[Tensor, "batch view height width rest 3"]:
    """Convert raw coefficients, red, green and blue of each, from the frame of their camera to the world frame."""
    height, num_rest = raw.shape[2], raw.shape[-1] // 3
    higher = rearrange(raw, "b v h w (rest rgb) -> b v (h w) rest rgb", rgb=3)
    if num_rest:
        forms = [torch.from_numpy(form).to(raw) for form in (LINEAR, QUADRATIC)]
        shares = raw.new_tensor(HARMONICS_SHARES[:num_rest])
        higher = rotated_harmonics(higher * shares[:, None], cameras.extrinsics[..., :3, :3], *forms)
    return rearrange(higher, "b v (h w) rest rgb -> b v h w rest rgb", h=height)


def _cell_positions(like: Tensor, height: int, width: int) -> Float[Tensor, "height width 2"]:
    """Return the normalised image position (u, v) of the centre of each cell."""
    v, u = torch.meshgrid(
        (torch.arange(height, device=like.device, dtype=like.dtype) + 0.5) / height,
        (torch.arange(width, device=like.device, dtype=like.dtype) + 0.5) / width,
        indexing="ij",
    )
    return torch.stack((u, v), dim=-1)


def _offset_uv(offset: Tensor, height: int, width: int) -> Tensor:
    """Convert raw offsets to normalised image units, bounded by `LARGEST_OFFSET_CELLS` cells."""
    # `new_tensor` would make constants of the sizes in an exported graph.
    size = [torch.scalar_tensor(side, dtype=offset.dtype, device=offset.device) for side in (width, height)]
    return LARGEST_OFFSET_CELLS * torch.tanh(offset) / torch.stack(size)
