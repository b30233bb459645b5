"""Feedback extractor E_fb: photographs and the rendering of stage 1 -> what is missing."""

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.config import CodecConfig, ReceiverConfig
from fecocodec.layers.blocks import BlockChain, RateCondition


class FeedbackExtractor(nn.Module):
    """concat(I, I - I1_hat) -> pixel unshuffle 4 -> 1x1 conv -> 2D blocks at 1/4 -> F2.

    The paper concatenates I and I1_hat; the difference carries the same information, and is what the stage is about.
    """

    def __init__(self, sender: CodecConfig, receiver: ReceiverConfig) -> None:
        super().__init__()
        self.input = nn.Conv2d(2 * 3 * 16, receiver.state_channels, 1)
        self.blocks = BlockChain(receiver.state_channels, sender.fine_hidden, 2)

    def forward(
        self,
        images: Float[Tensor, "item 3 h w"],
        renderings: Float[Tensor, "item 3 h w"],
        condition: RateCondition,
    ) -> Float[Tensor, "item channel h4 w4"]:
        """Both inputs sRGB in [0, 1]; sides multiples of 4."""
        stacked = torch.cat((2.0 * images - 1.0, 4.0 * (images - renderings)), dim=1)
        return self.blocks(self.input(F.pixel_unshuffle(stacked, 4)), condition)
