"""Use a third-party extractor as E_mv: a small trained adapter maps its full-resolution features to F1.

The paper builds its larger variant in this way (appendix, "Compression Using CodecSplat's Multi-View Feature
Extractor"): pixel unshuffle to 1/4 resolution, then three 2D blocks. The extractor is frozen; the other networks are
initialised from a trained model.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Bool, Float
from torch import Tensor, nn

from fecocodec.errors import ModelError
from fecocodec.geometry.cameras import Cameras
from fecocodec.grid import FEATURES
from fecocodec.layers.blocks import BlockChain, PlainBlock2d, PointwiseConv2d, RateCondition
from fecocodec.receiver.state import Features
from fecocodec.sender.extractors.protocol import Images, MatchedDepth, Matching
from fecocodec.sender.scene import Guides

NUM_BLOCKS, HIDDEN = 3, 96


@runtime_checkable
class LargeExtractor(Protocol):
    """Interface of a third-party extractor. Its weights are not stored in the sender's weights file."""

    def num_channels(self) -> int:
        """Return the number of channels of the features."""

    def features(self, images: Images, cameras: Cameras) -> Float[Tensor, "batch view channel h w"]:
        """Return features at the resolution of the images, on their device.

        images: sRGB in [0, 1], sides multiples of 32. cameras: scenes normalised to near = 1. The features must be
        deterministic.
        """

    def fingerprint(self) -> str:
        """Return a text that identifies the weights, such as a digest. A sender loads only with the same text."""


@dataclass(frozen=True)
class AdaptedFeatures(Matching):
    """The frozen features at 1/4 resolution, before adaptation.

    A third-party extractor returns no depth: its disparity is 0.5 and its consistency 0, so stage 2 gets no depth
    feedback.
    """

    unshuffled: Float[Tensor, "item channel16 h4 w4"]


class AdaptedExtractor(nn.Module):
    """features -> pixel unshuffle 4 -> 1x1 conv -> three 2D blocks -> F1. Parameters: 1x1 conv and blocks only."""

    is_conditioned = False

    def __init__(self, extractor: LargeExtractor, channels: int) -> None:
        super().__init__()
        self._frozen = (extractor,)  # a tuple keeps it out of this module's parameters
        self.input = PointwiseConv2d(16 * extractor.num_channels(), channels)
        self.blocks: nn.Module = nn.Sequential(*(PlainBlock2d(channels, HIDDEN) for _ in range(NUM_BLOCKS)))

    def match(
        self,
        images: Images,
        cameras: Cameras,
        guides: Guides | None = None,
        ignored: Bool[Tensor, "view h w"] | None = None,
    ) -> AdaptedFeatures:
        """Run the frozen extractor, without guides and masks. Raises ModelError for features of another shape."""
        extractor = self.frozen
        with torch.no_grad():
            features = extractor.features(images, cameras)
        batch, views, _, h, w = images.shape
        if features.shape != (batch, views, extractor.num_channels(), h, w):
            raise ModelError(
                f"extractor {extractor.fingerprint()}: gave features {tuple(features.shape)} for images "
                f"{tuple(images.shape)}; return one vector of {extractor.num_channels()} channels a pixel."
            )
        unshuffled = F.pixel_unshuffle(rearrange(features, "b v c h w -> (b v) c h w"), FEATURES)
        disparity = unshuffled.new_full((len(unshuffled), 1, h // FEATURES, w // FEATURES), 0.5)
        return AdaptedFeatures(disparity, MatchedDepth(disparity, torch.zeros_like(disparity)), unshuffled)

    @property
    def frozen(self) -> LargeExtractor:
        return self._frozen[0]

    @property
    def before_fusion(self) -> tuple[nn.Module | nn.Parameter, ...]:
        """The frozen extractor has no parts here."""
        return ()

    def fuse(self, images: Images, matching: AdaptedFeatures, condition: RateCondition | None = None) -> Features:
        """Run the trained adapter. The images and the condition are not used."""
        return self.blocks(self.input(matching.unshuffled))


class ConditionedAdapter(AdaptedExtractor):
    """`AdaptedExtractor` whose 2D blocks are conditioned on lambda by AdaLN, as every 2D block of the paper is."""

    is_conditioned = True

    def __init__(self, extractor: LargeExtractor, channels: int) -> None:
        super().__init__(extractor, channels)
        self.blocks = BlockChain(channels, HIDDEN, NUM_BLOCKS)

    def fuse(self, images: Images, matching: AdaptedFeatures, condition: RateCondition | None = None) -> Features:
        """Run the trained adapter. Raises ModelError without a condition."""
        if condition is None:
            raise ModelError("The adapter depends on lambda; call `fuse` with a rate condition.")
        features: Tensor = self.blocks(self.input(matching.unshuffled), condition)
        return features
