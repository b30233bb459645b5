"""Depth completion: relative disparity where no other view confirms what was matched, from monocular features."""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.layers.blocks import PlainBlock2d, PointwiseConv2d, downsample, upsample
from fecocodec.sender.extractors.dinov2 import FEATURES

CHANNELS = (64, 96, 128, 160)  # at 1/4, 1/8, 1/16 and 1/32 of the images
MONOCULAR_CHANNELS = 96
FEATURE_SCALE = 0.5  # of the monocular features, whose standard deviation is 2 to 4
_NUM_MAPS, _NUM_PIXELS = 5, 48


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


class DepthCompletion(nn.Module):
    """matched maps, pixels, monocular features -> U-Net (1/4 to 1/32) -> correction of the blended disparity.

    The correction is zero before training. The coarsest level also gets its mean over the view, with which the network
    can align depth globally.
    """

    def __init__(self) -> None:
        super().__init__()
        fine, *coarser = CHANNELS
        levels = list(zip(CHANNELS, coarser, strict=False))
        self.monocular = PointwiseConv2d(FEATURES, MONOCULAR_CHANNELS)
        self.input = PointwiseConv2d(_NUM_MAPS + _NUM_PIXELS + MONOCULAR_CHANNELS, fine)
        self.before = nn.ModuleList(PlainBlock2d(channels, channels) for channels, _ in levels)
        self.down = nn.ModuleList(downsample(channels, below) for channels, below in levels)
        self.view = nn.Linear(CHANNELS[-1], CHANNELS[-1])
        self.coarsest = nn.Sequential(*(PlainBlock2d(CHANNELS[-1], CHANNELS[-1]) for _ in range(2)))
        self.up = nn.ModuleList(upsample(below, channels) for channels, below in levels)
        self.after = nn.ModuleList(PlainBlock2d(channels, channels) for channels, _ in levels)
        self.output = PointwiseConv2d(fine, 1)
        nn.init.zeros_(self.output.weight)
        nn.init.zeros_(self.output.bias)

    def forward(
        self,
        matched: MatchedMaps,
        images: Float[Tensor, "item 3 h w"],
        features: Float[Tensor, "item feature rows columns"],
    ) -> Float[Tensor, "item 1 h4 w4"]:
        """Return relative disparity in [0, 1]. images: sRGB in [0, 1], sides multiples of 32. features: DINOv2's."""
        blended = matched.blended
        disparities = [2.0 * x - 1.0 for x in (blended, matched.disparity, matched.extrapolated)]
        monocular = F.interpolate(
            self.monocular(FEATURE_SCALE * features), blended.shape[-2:], mode="bilinear", align_corners=False
        )
        pixels = F.pixel_unshuffle(2.0 * images - 1.0, 4)
        x = self.input(torch.cat((*disparities, matched.consistency, matched.confidence, pixels, monocular), dim=1))
        skipped = []
        for block, down in zip(self.before, self.down, strict=True):
            skipped.append(block(x))
            x = down(skipped[-1])
        x = self.coarsest(x + self.view(x.mean(dim=(2, 3)))[:, :, None, None])
        for block, up in zip(reversed(self.after), reversed(self.up), strict=True):
            x = block(up(x) + skipped.pop())
        return (blended + self.output(x)).clamp(0.0, 1.0)
