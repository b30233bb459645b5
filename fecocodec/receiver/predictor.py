"""Gaussian predictor P: state S and cameras -> attributes of 3D Gaussians, which `emit` turns into Gaussians."""

import torch
import torch.nn.functional as F
from einops import rearrange, repeat
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.config import ReceiverConfig
from fecocodec.geometry.cameras import Cameras, camera_to_world_points, depth_from_relative_disparity, pixel_rays
from fecocodec.layers.blocks import (
    Block2d,
    PointwiseConv2d,
    RateCondition,
    downsample,
    pixel_shuffle,
    residual_branch,
    upsample,
)
from fecocodec.receiver.neighbour_attention import NeighbourAttention
from fecocodec.receiver.state import Features
from fecocodec.splatting.attributes import RAW, activate
from fecocodec.splatting.emission import Prediction

Disparity = Float[Tensor, "batch view h4 w4"]  # relative disparity
Detail = Float[Tensor, "item raw h2 w2"]  # added to the raw outputs of the head


class Predictor(nn.Module):
    """S -> U-Net (1/4 to 1/16) -> depth (1/4) -> points -> KNN attention in 3D (1/8) -> head -> shuffle -> attributes.

    Attention runs at 1/8 resolution, because at 1/4 it dominates the decoding time (docs/what_we_learned.md).
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
        outputs = sum(RAW.values()) + 3 * ((config.sh_degree + 1) ** 2 - 1)
        first, last = PointwiseConv2d(fine, fine), PointwiseConv2d(fine, config.gaussians_per_side**2 * outputs)
        self.head = nn.Sequential(first, nn.GELU(approximate="tanh"), last)
        nn.init.normal_(last.weight, std=0.02)
        nn.init.constant_(last.get_parameter("bias"), 0.0)

    def forward(
        self, state: Features, cameras: Cameras, condition: RateCondition, detail: Detail | None = None
    ) -> Prediction:
        """Predict attributes of Gaussians in the frame of the cameras.

        item: (batch view). cameras: with one batch dimension. detail: added to the raw outputs of the head, see
        `DetailBasis`.
        """
        return self.at_head(*self.before_head(state, cameras, condition), cameras, detail)

    def before_head(
        self, state: Features, cameras: Cameras, condition: RateCondition
    ) -> tuple[Features, Features, Disparity]:
        """Return the features, the residual of attention and the relative disparity, from which the head predicts."""
        features, relative = self.geometry(state, cameras.num_views, condition)
        with residual_branch():
            attended = self._attend(features, relative, cameras)
        return features, attended, relative

    def geometry(self, state: Features, views: int, condition: RateCondition) -> tuple[Features, Disparity]:
        """Return features and relative disparity, the part of the predictor before attention."""
        with residual_branch():
            coarser = self._coarser(state, condition)
        features = self.fine(state + coarser, condition)
        relative = 1.1 * torch.sigmoid(self.depth_head(features)[:, 0].float()) - 0.05
        return features, rearrange(relative, "(b v) h w -> b v h w", v=views)

    def at_head(
        self,
        features: Features,
        attended: Features,
        relative: Disparity,
        cameras: Cameras,
        detail: Detail | None = None,
    ) -> Prediction:
        """Return the prediction, the part of the predictor after attention. attended: residual of the features."""
        shuffled = pixel_shuffle(self.head(features + attended).float(), self.config.gaussians_per_side)
        if detail is not None:
            shuffled = shuffled + detail
        raw = rearrange(shuffled, "(b v) c h w -> b v h w c", v=cameras.num_views)
        return Prediction(activate(raw, relative, cameras), relative)

    def _coarser(self, state: Tensor, condition: RateCondition) -> Tensor:
        """Return the residual of the U-Net's levels at 1/8 and 1/16."""
        middle = self.middle_in(self.down_fine(state), condition)
        coarse = self.coarse(self.down_middle(middle), condition)
        return self.up_middle(self.middle_out(middle + self.up_coarse(coarse), condition))

    def _attend(self, features: Tensor, relative: Tensor, cameras: Cameras) -> Tensor:
        """Return the residual of KNN attention over the points of all views, per scene, at half the resolution."""
        points, depth = self.attention_points(relative, cameras)
        pooled, views = F.avg_pool2d(features, 2), cameras.num_views
        height, width = pooled.shape[-2:]
        scenes = zip(
            [self.attention.search(scene) for scene in points],
            rearrange(pooled, "(b v) c h w -> b (v h w) c", v=views),
            points,
            depth,
            repeat(cameras.world_to_camera[..., :3, :3], "b v i j -> b (v h w) i j", h=height, w=width),
            strict=True,
        )
        attended = torch.stack([self.attention(*scene) for scene in scenes])
        return enlarged(rearrange(attended, "b (v h w) c -> (b v) c h w", v=views, h=height, w=width))

    def attention_points(
        self, relative: Disparity, cameras: Cameras
    ) -> tuple[Float[Tensor, "batch n 3"], Float[Tensor, "batch n"]]:
        """Return the points of KNN attention in the frame of the cameras, and their depths, at half the resolution."""
        relative = F.avg_pool2d(relative, 2)
        height, width = relative.shape[-2:]
        depth = depth_from_relative_disparity(relative, cameras)
        points = camera_to_world_points(cameras, pixel_rays(cameras, height, width) * depth[..., None])
        return rearrange(points, "b v h w xyz -> b (v h w) xyz"), rearrange(depth, "b v h w -> b (v h w)")


def enlarged(attended: Float[Tensor, "item channel h8 w8"]) -> Features:
    """Return the residual of attention at the resolution of the features."""
    return F.interpolate(attended, scale_factor=2.0, mode="nearest")
