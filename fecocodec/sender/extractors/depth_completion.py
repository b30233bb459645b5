"""Depth completion: relative disparity where no other view confirms what was matched, from monocular features."""

import math
from dataclasses import dataclass, fields

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.layers.blocks import PlainBlock2d, PointwiseConv2d, downsample, upsample
from fecocodec.sender.extractors.dinov2 import FEATURES
from fecocodec.sender.extractors.vision_transformer import Block

TOKEN_CHANNELS, NUM_BLOCKS, NUM_HEADS = 192, 4, 6
CHANNELS = (48, 80, 128)  # of the U-Net, at 1/4, 1/8 and 1/16 of the images
PROJECTED_CHANNELS = 64  # of the tokens, for the U-Net
FEATURE_SCALE = 0.3  # of the monocular features, whose standard deviation is 2 to 4
CONSISTENCY_POWER = 4  # exponent of the consistency in means of the matched disparity
WAVES = (1, 2, 4, 8)  # half periods over the image, of the encoding of positions
_NUM_TOKEN_MAPS, _NUM_MAPS, _NUM_PIXELS = 8, 6, 48
_LEAST_WEIGHT = 1e-3


@dataclass(frozen=True)
class MatchedMaps:
    """What matching found out about the views, without gradient; item = (batch view), at 1/4 resolution, in [0, 1].

    disparity: relative disparity after aggregation. consistency: its cross-view consistency. confidence: its largest
    probability. extrapolated: relative disparity of the planes of confirmed neighbours.
    """

    disparity: Float[Tensor, "item 1 h4 w4"]
    consistency: Float[Tensor, "item 1 h4 w4"]
    confidence: Float[Tensor, "item 1 h4 w4"]
    extrapolated: Float[Tensor, "item 1 h4 w4"]

    @property
    def blended(self) -> Float[Tensor, "item 1 h4 w4"]:
        """Matched disparity where it is consistent, extrapolated disparity elsewhere."""
        return torch.lerp(self.extrapolated, self.disparity, self.consistency)

    def first(self, count: int) -> "MatchedMaps":
        """Return the maps of the first `count` views."""
        return MatchedMaps(*(getattr(self, entry.name)[:count] for entry in fields(self)))


class DepthCompletion(nn.Module):
    """matched maps and monocular features -> transformer on the patches of a view -> correction of unconfirmed
    disparity; this, the maps and the pixels -> U-Net (1/4 to 1/16) -> correction of all disparity.

    Both corrections of the blended disparity are zero before training.
    """

    def __init__(self) -> None:
        super().__init__()
        fine, *coarser = CHANNELS
        levels = list(zip(CHANNELS, coarser, strict=False))
        self.token = nn.Linear(FEATURES, TOKEN_CHANNELS)
        self.token_maps = nn.Linear(_NUM_TOKEN_MAPS, TOKEN_CHANNELS)
        self.token_position = nn.Linear(2 + 4 * len(WAVES), TOKEN_CHANNELS)
        self.blocks = nn.ModuleList(
            Block(TOKEN_CHANNELS, NUM_HEADS, 2 * TOKEN_CHANNELS, first_scale=1.0) for _ in range(NUM_BLOCKS)
        )
        self.norm = nn.LayerNorm(TOKEN_CHANNELS)
        self.coarse, self.projected = nn.Linear(TOKEN_CHANNELS, 1), nn.Linear(TOKEN_CHANNELS, PROJECTED_CHANNELS)
        self.input = PointwiseConv2d(_NUM_MAPS + _NUM_PIXELS + PROJECTED_CHANNELS, fine)
        self.before = nn.ModuleList(PlainBlock2d(channels, channels) for channels, _ in levels)
        self.down = nn.ModuleList(downsample(channels, below) for channels, below in levels)
        self.coarsest = PlainBlock2d(CHANNELS[-1], CHANNELS[-1])
        self.up = nn.ModuleList(upsample(below, channels) for channels, below in levels)
        self.after = nn.ModuleList(PlainBlock2d(channels, channels) for channels, _ in levels)
        self.output = PointwiseConv2d(fine, 1)
        for parameter in (*self.coarse.parameters(), *self.output.parameters()):
            nn.init.zeros_(parameter)

    def forward(
        self,
        matched: MatchedMaps,
        images: Float[Tensor, "item 3 h w"],
        features: Float[Tensor, "item feature rows columns"],
    ) -> Float[Tensor, "item 1 h4 w4"]:
        """Return relative disparity in [0, 1]. images: sRGB in [0, 1], sides multiples of 16. features: DINOv2's."""
        size, rows = matched.disparity.shape[-2:], features.shape[-2]
        tokens = self._tokens(matched, features)
        correction, projected = (
            F.interpolate(_as_map(head(tokens), rows), size, mode="bilinear", align_corners=False)
            for head in (self.coarse, self.projected)
        )
        first = matched.blended + correction * (1.0 - matched.consistency)
        maps = (matched.blended, matched.disparity, matched.extrapolated, first)
        pixels = F.pixel_unshuffle(2.0 * images - 1.0, 4)
        inputs = (*(2.0 * x - 1.0 for x in maps), matched.consistency, matched.confidence, pixels, projected)
        return (first + self._refined(torch.cat(inputs, dim=1))).clamp(0.0, 1.0)

    def _tokens(
        self, matched: MatchedMaps, features: Float[Tensor, "item feature rows columns"]
    ) -> Float[Tensor, "item token channel"]:
        rows, columns = features.shape[-2:]
        weight = matched.consistency**CONSISTENCY_POWER
        signed = [2.0 * x - 1.0 for x in (matched.blended, matched.disparity, matched.extrapolated)]
        maps = torch.cat((*signed, weight, weight * signed[1], matched.consistency, matched.confidence), dim=1)
        maps = F.adaptive_avg_pool2d(maps, (rows, columns))
        confirmed = F.adaptive_avg_pool2d(weight * matched.disparity, (rows, columns)) / (maps[:, 3:4] + _LEAST_WEIGHT)
        tokens = self.token(_as_tokens(FEATURE_SCALE * features)) + self.token_maps(
            _as_tokens(torch.cat((maps, confirmed), dim=1))
        )
        tokens = tokens + self.token_position(_as_tokens(_positions(rows, columns, features.device)))
        for block in self.blocks:
            tokens = block(tokens)
        return self.norm(tokens)

    def _refined(self, inputs: Float[Tensor, "item input h4 w4"]) -> Float[Tensor, "item 1 h4 w4"]:
        x, skipped = self.input(inputs), []
        for block, down in zip(self.before, self.down, strict=True):
            skipped.append(block(x))
            x = down(skipped[-1])
        x = self.coarsest(x)
        for block, up in zip(reversed(self.after), reversed(self.up), strict=True):
            x = block(up(x) + skipped.pop())
        return self.output(x)


def _positions(rows: int, columns: int, device: torch.device) -> Float[Tensor, "1 encoding rows columns"]:
    """Return the encoding of positions in the image: (x, y) in [-1, 1], and sines and cosines of them."""
    y, x = ((torch.arange(count, device=device) + 0.5) / count for count in (rows, columns))
    y, x = torch.meshgrid(y, x, indexing="ij")
    waves = [wave(math.pi * number * z) for number in WAVES for z in (x, y) for wave in (torch.sin, torch.cos)]
    return torch.stack((2.0 * x - 1.0, 2.0 * y - 1.0, *waves))[None]


def _as_tokens(x: Float[Tensor, "item channel rows columns"]) -> Float[Tensor, "item token channel"]:
    return rearrange(x, "i c h w -> i (h w) c")


def _as_map(x: Float[Tensor, "item token channel"], rows: int) -> Float[Tensor, "item channel rows columns"]:
    return rearrange(x, "i (h w) c -> i c h w", h=rows)
