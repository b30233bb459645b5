"""Gaussian predictor P: implicit Gaussian state and cameras -> 3D Gaussians."""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from einops import rearrange, repeat
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.config import ReceiverConfig
from fecocodec.geometry.cameras import Cameras, camera_to_world_points, pixel_rays, rays_through
from fecocodec.geometry.depth import depth_from_relative_disparity
from fecocodec.geometry.gaussians import SH_DEGREE_0, Gaussians
from fecocodec.geometry.rotations import multiply, quaternion_from_matrix
from fecocodec.layers.blocks import Block2d, RateCondition, downsample, pixel_shuffle, residual_branch, upsample
from fecocodec.receiver.free_space import free_space_violation
from fecocodec.receiver.neighbour_attention import NeighbourAttention

PER_CELL = 4  # Gaussians per cell of the 1/4 grid: one per 2x2 pixels
LARGEST_OFFSET_CELLS = 1.0  # how far a Gaussian may leave its place, in cells of the 1/2 grid
LARGEST_DISPARITY_STEP = 0.08  # how far a Gaussian may leave its cell's relative disparity
LARGEST_LOG_SCALE = 2.5  # scales lie within a factor exp(+-2.5) of 0.67 footprints
RAW = {"opacity": 1, "offset": 2, "disparity": 1, "scale": 3, "rotation": 4, "colour": 3}  # head outputs a Gaussian


@dataclass(frozen=True)
class Prediction:
    """Gaussians of every scene of the batch, ordered (view, row, column) on the 1/2 grid, and the disparity at 1/4."""

    gaussians: Gaussians
    relative_disparity: Float[Tensor, "batch view h4 w4"]


class Predictor(nn.Module):
    """S -> U-Net (1/4 to 1/16) -> depth (1/4) -> points -> KNN attention in 3D (1/8) -> head -> shuffle -> Gaussians.

    The attention works on points at 1/8: at 1/4 it took 47 of 115 ms of decoding (docs/experiments.md).
    """

    def __init__(self, config: ReceiverConfig) -> None:
        super().__init__()
        self.config = config
        fine, (middle, coarse) = config.state_channels, config.predictor_channels
        self.down_fine, self.down_middle = downsample(fine, middle), downsample(middle, coarse)
        self.middle_in, self.middle_out = Block2d(middle, middle), Block2d(middle, middle)
        self.coarse = Block2d(coarse, coarse)
        self.up_coarse, self.up_middle = upsample(coarse, middle), upsample(middle, fine)
        self.fine = Block2d(fine, config.fine_hidden, is_residual_branch=True)
        self.depth_head = nn.Conv2d(fine, 1, 3, padding=1)
        self.attention = NeighbourAttention(
            fine, config.attention_channels, config.num_neighbours, config.neighbour_fade
        )
        first, last = nn.Conv2d(fine, fine, 1), nn.Conv2d(fine, PER_CELL * sum(RAW.values()), 1)
        self.head = nn.Sequential(first, nn.GELU(approximate="tanh"), last)
        nn.init.normal_(last.weight, std=0.02)
        nn.init.constant_(last.get_parameter("bias"), 0.0)

    def forward(
        self, state: Float[Tensor, "item channel h4 w4"], cameras: Cameras, condition: RateCondition
    ) -> Prediction:
        """item = (batch view); cameras has one batch dimension. Means come out in the frame and unit of the cameras."""
        views = cameras.num_views
        with residual_branch():
            coarser = self._coarser(state, condition)
        features = self.fine(state + coarser, condition)
        relative = 1.1 * torch.sigmoid(self.depth_head(features)[:, 0].float()) - 0.05
        relative = rearrange(relative, "(b v) h w -> b v h w", v=views)
        with residual_branch():
            found = self._attend(features, relative, cameras)
        raw = rearrange(pixel_shuffle(self.head(features + found).float()), "(b v) c h w -> b v h w c", v=views)
        return Prediction(self._activate(raw, relative, cameras), relative)

    def _coarser(self, state: Tensor, condition: RateCondition) -> Tensor:
        """What the U-Net's levels at 1/8 and 1/16 add to the state."""
        middle = self.middle_in(self.down_fine(state), condition)
        coarse = self.coarse(self.down_middle(middle), condition)
        return self.up_middle(self.middle_out(middle + self.up_coarse(coarse), condition))

    def _attend(self, features: Tensor, relative: Tensor, cameras: Cameras) -> Tensor:
        """What KNN attention over the points of all views of a scene adds to the features; scene by scene, at half the
        features' resolution.
        """
        views = cameras.num_views
        pooled = F.avg_pool2d(features, 2)
        relative = F.avg_pool2d(relative, 2)
        height, width = relative.shape[-2:]
        depth = depth_from_relative_disparity(relative, cameras)
        points = camera_to_world_points(cameras, pixel_rays(cameras, height, width) * depth[..., None])
        scenes = zip(
            rearrange(pooled, "(b v) c h w -> b (v h w) c", v=views),
            rearrange(points, "b v h w xyz -> b (v h w) xyz"),
            rearrange(depth, "b v h w -> b (v h w)"),
            repeat(cameras.world_to_camera[..., :3, :3], "b v i j -> b (v h w) i j", h=height, w=width),
            strict=True,
        )
        found = torch.stack([self.attention(*scene) for scene in scenes])
        found = rearrange(found, "b (v h w) c -> (b v) c h w", v=views, h=height)
        return F.interpolate(found, scale_factor=2.0, mode="nearest")

    def _activate(self, raw: Tensor, relative: Tensor, cameras: Cameras) -> Gaussians:
        """Raw head outputs on the 1/2 grid -> bounded Gaussian attributes; float32 throughout."""
        height, width = raw.shape[2:4]
        opacity, offset, disparity, scale, rotation, colour = raw.split([*RAW.values()], dim=-1)
        fine = F.interpolate(relative, size=(height, width), mode="bilinear", align_corners=False)
        depth = depth_from_relative_disparity(fine + LARGEST_DISPARITY_STEP * torch.tanh(disparity[..., 0]), cameras)
        rays = rays_through(cameras, _cell_positions(raw, height, width) + _offset_uv(offset, height, width))
        # Of a cell of the 1/2 grid, in scene units.
        footprint = depth / (cameras.intrinsics[..., 0, 0, None, None] * width)
        scales = footprint[..., None] * torch.exp(LARGEST_LOG_SCALE * torch.tanh(scale / LARGEST_LOG_SCALE) - 0.4)
        identity = raw.new_tensor([1.0, 0.0, 0.0, 0.0])
        local = F.normalize(rotation + identity, dim=-1)
        view_to_world = quaternion_from_matrix(cameras.extrinsics[..., :3, :3])[..., None, None, :]
        colour, opacity = torch.sigmoid(2.0 * colour), torch.sigmoid(opacity[..., 0] + 2.0)
        means = camera_to_world_points(cameras, rays * depth[..., None])
        opacity = opacity * (1.0 - free_space_violation(means, depth, colour, opacity, cameras, self.config))
        return Gaussians(
            means=rearrange(means, "b v h w xyz -> b (v h w) xyz"),
            scales=rearrange(scales, "b v h w xyz -> b (v h w) xyz"),
            rotations=rearrange(multiply(view_to_world, local), "b v h w q -> b (v h w) q"),
            opacities=rearrange(opacity, "b v h w -> b (v h w)"),
            harmonics=rearrange((colour - 0.5) / SH_DEGREE_0, "b v h w rgb -> b (v h w) 1 rgb"),
        )


def _cell_positions(like: Tensor, height: int, width: int) -> Float[Tensor, "height width 2"]:
    """Normalised image position (u, v) of the centre of each cell."""
    v, u = torch.meshgrid(
        (torch.arange(height, device=like.device, dtype=like.dtype) + 0.5) / height,
        (torch.arange(width, device=like.device, dtype=like.dtype) + 0.5) / width,
        indexing="ij",
    )
    return torch.stack((u, v), dim=-1)


def _offset_uv(offset: Tensor, height: int, width: int) -> Tensor:
    """Image-plane offset in normalised units, at most `LARGEST_OFFSET_CELLS` cells."""
    return LARGEST_OFFSET_CELLS * torch.tanh(offset) / offset.new_tensor([width, height])
