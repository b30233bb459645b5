"""Any other extractor as E_mv: its full-resolution features, brought to F1 by a small trained adapter.

The paper builds its larger variant so (appendix, "Compression Using CodecSplat's Multi-View Feature Extractor"):
PixelUnshuffle to 1/4 resolution, three 2D blocks; the extractor is frozen, the rest starts from a trained model.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.errors import ModelError
from fecocodec.geometry.cameras import Cameras
from fecocodec.layers.blocks import PlainBlock2d
from fecocodec.sender.matched_depth import MatchedDepth

NUM_BLOCKS, HIDDEN = 3, 96


@runtime_checkable
class LargeExtractor(Protocol):
    """What an extractor of others must offer; its weights stay its own and are in no file of ours."""

    def num_channels(self) -> int:
        """Channels of the features."""

    def features(
        self, images: Float[Tensor, "batch view 3 h w"], cameras: Cameras
    ) -> Float[Tensor, "batch view channel h w"]:
        """Features at the images' own resolution, on their device; images sRGB in [0, 1], scenes normalised to
        near = 1, sides multiples of 32. The same input must give the same features."""

    def fingerprint(self) -> str:
        """A text that changes when the weights do, such as a digest; senders refuse to load with another one."""


@dataclass(frozen=True)
class AdaptedFeatures:
    """The frozen features at 1/4 resolution, before adaptation; item = (batch view).

    relative_disparity: the middle of the range, for an extractor says nothing of depth here.
    """

    unshuffled: Float[Tensor, "item channel16 h4 w4"]
    relative_disparity: Float[Tensor, "item 1 h4 w4"]

    @property
    def depth(self) -> MatchedDepth:
        """Nothing to go by."""
        return MatchedDepth(self.relative_disparity, torch.zeros_like(self.relative_disparity))


class AdaptedExtractor(nn.Module):
    """features -> pixel unshuffle 4 -> 1x1 conv -> three 2D blocks -> F1; only the last two have parameters here."""

    def __init__(self, extractor: LargeExtractor, channels: int) -> None:
        super().__init__()
        self._frozen = (extractor,)  # in a tuple, so that it is no part of this module's weights
        self.input = nn.Conv2d(16 * extractor.num_channels(), channels, 1)
        self.blocks = nn.Sequential(*(PlainBlock2d(channels, HIDDEN) for _ in range(NUM_BLOCKS)))

    def forward(
        self, images: Float[Tensor, "batch view 3 h w"], cameras: Cameras
    ) -> Float[Tensor, "item channel h4 w4"]:
        """F1 of every view."""
        return self.fuse(images, self.match(images, cameras))

    def match(self, images: Float[Tensor, "batch view 3 h w"], cameras: Cameras) -> AdaptedFeatures:
        """The frozen part. Raises ModelError where its features are not of the shape that was announced."""
        extractor = self._frozen[0]
        with torch.no_grad():
            features = extractor.features(images, cameras)
        batch, views, _, h, w = images.shape
        if features.shape != (batch, views, extractor.num_channels(), h, w):
            raise ModelError(
                f"extractor {extractor.fingerprint()}: gave features {tuple(features.shape)} for images "
                f"{tuple(images.shape)}; return one vector of {extractor.num_channels()} channels a pixel."
            )
        unshuffled = F.pixel_unshuffle(rearrange(features, "b v c h w -> (b v) c h w"), 4)
        return AdaptedFeatures(unshuffled, unshuffled.new_full((len(unshuffled), 1, h // 4, w // 4), 0.5))

    def fuse(
        self, images: Float[Tensor, "batch view 3 h w"], found: AdaptedFeatures
    ) -> Float[Tensor, "item channel h4 w4"]:
        """The trained part."""
        return self.blocks(self.input(found.unshuffled))
