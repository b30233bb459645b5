"""Feedback extractors E_fb: photographs, the rendering of stage 1 (and its depth errors) -> F2."""

from typing import ClassVar

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.config import CodecConfig, ReceiverConfig
from fecocodec.grid import FEATURES, VALUES_PER_CELL
from fecocodec.layers.blocks import BlockChain, PointwiseConv2d, RateCondition


class FeedbackExtractor(nn.Module):
    """concat(pixel unshuffle 4 of (I, I - I1_hat), depth errors) -> 1x1 conv -> 2D blocks at 1/4 -> F2.

    The paper concatenates I and I1_hat. The difference carries the same information at a scale that suits the network.
    The depth errors are an addition to the paper, see `depth_feedback`.
    """

    num_inputs: ClassVar[int] = 2 * VALUES_PER_CELL + 2

    def __init__(self, sender: CodecConfig, receiver: ReceiverConfig) -> None:
        super().__init__()
        self.input = PointwiseConv2d(self.num_inputs, receiver.state_channels)
        self.blocks = BlockChain(receiver.state_channels, sender.fine_hidden, 2)

    def forward(
        self,
        images: Float[Tensor, "item 3 h w"],
        renderings: Float[Tensor, "item 3 h w"],
        depth_errors: Float[Tensor, "item 2 h4 w4"],
        condition: RateCondition,
    ) -> Float[Tensor, "item channel h4 w4"]:
        """Return F2. images, renderings: sRGB in [0, 1], sides multiples of 4. depth_errors: see `depth_feedback`."""
        return self.blocks(self.input(self.inputs(images, renderings, depth_errors)), condition)

    @staticmethod
    def inputs(images: Tensor, renderings: Tensor, depth_errors: Tensor) -> Float[Tensor, "item input h4 w4"]:
        """Return the input of the 1x1 convolution. Arguments as for `forward`."""
        stacked = torch.cat((2.0 * images - 1.0, 4.0 * (images - renderings)), dim=1)
        return torch.cat((F.pixel_unshuffle(stacked, FEATURES), depth_errors), dim=1)


class PictureFeedbackExtractor(FeedbackExtractor):
    """pixel unshuffle 4 of concat(I, I1_hat) -> 1x1 conv -> 2D blocks at 1/4 -> F2, as the paper describes it."""

    num_inputs = 2 * VALUES_PER_CELL

    @staticmethod
    def inputs(images: Tensor, renderings: Tensor, depth_errors: Tensor) -> Float[Tensor, "item input h4 w4"]:
        """Return the input of the 1x1 convolution. The depth errors are not used."""
        return F.pixel_unshuffle(torch.cat((2.0 * images - 1.0, 2.0 * renderings - 1.0), dim=1), FEATURES)
