"""The cross-view U-Net that fuses matching, appearance and monocular features (based on that of latent diffusion).

All levels have equal widths; the coarsest one has attention over the positions of all views. The indices of the modules
in their lists match the public checkpoints.
"""

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.layers.blocks import FeatureMaps

CHANNELS, NUM_LEVELS = 128, 3  # at 1/4 resolution
_NUM_GROUPS, _HEAD_CHANNELS = 8, 32


class ResBlock(nn.Module):
    """Two (group norm, SiLU, 3x3 conv) with a residual connection."""

    def __init__(self, in_channels: int, channels: int) -> None:
        super().__init__()
        self.in_layers = nn.Sequential(_norm(in_channels), nn.SiLU(), _conv3(in_channels, channels))
        self.out_layers = nn.Sequential(_norm(channels), nn.SiLU(), nn.Identity(), _zero(_conv3(channels, channels)))
        self.skip_connection = nn.Identity() if in_channels == channels else nn.Conv2d(in_channels, channels, 1)

    def forward(self, x: Float[Tensor, "item _ h w"]) -> FeatureMaps:
        return self.skip_connection(x) + self.out_layers(self.in_layers(x))


class CrossViewAttention(nn.Module):
    """Self-attention over all positions of all views of a scene, without position encoding."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.norm = _norm(channels)
        self.qkv = nn.Conv1d(channels, 3 * channels, 1)
        self.proj_out = _zero(nn.Conv1d(channels, channels, 1))

    def forward(self, x: FeatureMaps, num_views: int) -> FeatureMaps:
        h = x.shape[-2]
        qkv = self.qkv(self.norm(x).flatten(2))
        query, key, value = rearrange(
            qkv, "(b v) (n three c) t -> three b n (v t) c", v=num_views, c=_HEAD_CHANNELS, three=3
        )
        attended = F.scaled_dot_product_attention(query, key, value)
        attended = rearrange(attended, "b n (v t) c -> (b v) (n c) t", v=num_views)
        return x + rearrange(self.proj_out(attended), "i c (h w) -> i c h w", h=h)


class Downsample(nn.Module):
    """3x3 conv of stride 2."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.op = nn.Conv2d(channels, channels, 3, stride=2, padding=1)

    def forward(self, x: FeatureMaps) -> Float[Tensor, "item channel h2 w2"]:
        return self.op(x)


class Upsample(nn.Module):
    """Nearest-neighbour upsampling by 2 -> 3x3 conv."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv = _conv3(channels, channels)

    def forward(self, x: FeatureMaps) -> Float[Tensor, "item channel h2 w2"]:
        return self.conv(F.interpolate(x, scale_factor=2, mode="nearest"))


class Stage(nn.ModuleList):
    """Sequence of layers; passes the number of views per scene to attention layers."""

    def forward(self, x: Float[Tensor, "item _ _ _"], num_views: int) -> Float[Tensor, "item channel _ _"]:
        for layer in self:
            x = layer(x, num_views) if isinstance(layer, CrossViewAttention) else layer(x)
        return x


class CrossViewUNet(nn.Module):
    """conv -> downsampling levels -> middle -> upsampling levels with skip connections."""

    def __init__(self, channels: int = CHANNELS, num_levels: int = NUM_LEVELS) -> None:
        super().__init__()
        down: list[list[nn.Module]] = [[_conv3(channels, channels)]]
        for level in range(num_levels):
            is_coarsest = level == num_levels - 1
            attention = [CrossViewAttention(channels)] if is_coarsest else []
            down += [[ResBlock(channels, channels), *attention]]
            down += [] if is_coarsest else [[Downsample(channels)]]
        self.input_blocks = _stages(*down)
        self.middle_block = Stage([ResBlock(channels, channels), nn.Identity(), ResBlock(channels, channels)])
        up: list[list[nn.Module]] = []
        for level in reversed(range(num_levels)):
            for is_last in (False, True):
                attention = [CrossViewAttention(channels)] if level == num_levels - 1 else []
                enlarged = [Upsample(channels)] if is_last and level else []
                up += [[ResBlock(2 * channels, channels), *attention, *enlarged]]
        self.output_blocks = _stages(*up)
        self.out = nn.Sequential(_norm(channels), nn.SiLU(), _zero(_conv3(channels, channels)))

    def forward(self, x: FeatureMaps, num_views: int) -> FeatureMaps:
        """item = (batch view); sides multiples of 2 to the power of (levels - 1)."""
        skips: list[Tensor] = []
        for stage in self.input_blocks:
            x = stage(x, num_views)
            skips.append(x)
        x = self.middle_block(x, num_views)
        for stage in self.output_blocks:
            x = stage(torch.cat((x, skips.pop()), dim=1), num_views)
        return self.out(x)


def _stages(*stages: list[nn.Module]) -> nn.ModuleList:
    return nn.ModuleList(Stage(layers) for layers in stages)


def _norm(channels: int) -> nn.GroupNorm:
    return nn.GroupNorm(_NUM_GROUPS, channels)


def _conv3(in_channels: int, channels: int) -> nn.Conv2d:
    return nn.Conv2d(in_channels, channels, 3, padding=1)


def _zero(layer: nn.Conv1d | nn.Conv2d) -> nn.Module:
    """Initialise all parameters of a layer to 0, so that its residual branch starts as the identity."""
    for parameter in layer.parameters():
        nn.init.zeros_(parameter)
    return layer
