"""Networks of the sender. Encoding also needs the networks of the receiver, for S1 and G1."""

from collections.abc import Callable
from typing import Any, ClassVar

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.config import (
    NO_CONTEXT,
    NO_FEEDBACK,
    AdaptedSenderConfig,
    CodecConfig,
    LargeSenderConfig,
    PaperSenderConfig,
    ReceiverConfig,
    SenderConfig,
)
from fecocodec.errors import ModelError
from fecocodec.grid import FEATURES, VALUES_PER_CELL
from fecocodec.layers.blocks import Block2d, BlockChain, PointwiseConv2d, RateCondition, downsample
from fecocodec.receiver.state import Features, Latents
from fecocodec.sender.extractors.adapter import AdaptedExtractor, ConditionedAdapter
from fecocodec.sender.extractors.compact import CompactExtractor
from fecocodec.sender.extractors.depthsplat_base.extractor import DepthSplatBase
from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall
from fecocodec.sender.step_network import StepNetwork

Build = Callable[[Any, int], nn.Module]  # (configuration, channels of F1) -> an `Extractor`


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
    ) -> Features:
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


def _adapted(config: AdaptedSenderConfig, channels: int) -> nn.Module:
    raise ModelError(
        f"extractor {config.extractor}: its own network is needed too; encode and evaluate in Python, as "
        '"Larger extractors" in docs/paper_profile.md shows.'
    )


EXTRACTORS: dict[type[CodecConfig], Build] = {
    SenderConfig: CompactExtractor,
    PaperSenderConfig: lambda config, channels: DepthSplatSmall(config.geometry, config.matching_scale),
    LargeSenderConfig: lambda config, channels: ConditionedAdapter(DepthSplatBase(), channels),
    AdaptedSenderConfig: _adapted,
}
"""A new extractor is one file, with its configuration and a class that follows the protocol `Extractor`, and one line
here. `encode` and `train` then load it by the name in its configuration; tests/sender/test_new_extractor.py adds one.
"""


LARGEST_LATENT = 2.0**15  # far above trained latents; bounds the symbols of unusual inputs


class Analysis(nn.Module):
    """concat(F, S) -> 1x1 conv -> 2D block at 1/4 -> downsample -> 2D blocks at 1/8 -> y, shared by both stages."""

    def __init__(self, sender: CodecConfig, receiver: ReceiverConfig) -> None:
        super().__init__()
        channels, width = receiver.state_channels, sender.analysis_channels
        self.join = PointwiseConv2d(2 * channels, channels)
        self.fine = Block2d(channels, sender.fine_hidden)
        self.down = downsample(channels, width)
        self.coarse = BlockChain(width, width, 2)
        self.output = nn.Conv2d(width, receiver.latent_channels, 3, padding=1)

    def forward(self, features: Features, state: Features, condition: RateCondition) -> Latents:
        fine = self.fine(self.join(torch.cat((features, state), dim=1)), condition)
        latent = condition.latent_gain * self.output(self.coarse(self.down(fine), condition))
        return latent.clamp(-LARGEST_LATENT, LARGEST_LATENT)


class HyperAnalysis(nn.Module):
    """y (1/8) -> signed log -> 3x3 conv -> two convolutions of stride 2 -> z (1/32)."""

    def __init__(self, receiver: ReceiverConfig) -> None:
        super().__init__()
        width = 64
        self.layers = nn.Sequential(
            nn.Conv2d(receiver.latent_channels, width, 3, padding=1),
            nn.GELU(approximate="tanh"),
            nn.Conv2d(width, width, 4, stride=2, padding=1),
            nn.GELU(approximate="tanh"),
            nn.Conv2d(width, receiver.hyper_channels, 4, stride=2, padding=1),
        )

    def forward(self, y: Latents) -> Float[Tensor, "item hyper h32 w32"]:
        compressed = torch.sign(y) * torch.log1p(y.abs())  # the range of y varies by decades with lambda
        return F.hardtanh(self.layers(compressed), -LARGEST_LATENT, LARGEST_LATENT)


class Sender(nn.Module):
    """E_mv, E_fb, g_a and h_a. g_a and h_a are shared by both stages; E_mv depends on the profile.

    steps: proposes the steps of latent optimisation; None for steps along the gradient. sharp_steps: proposes steps
    towards sharper pictures; None if there are none.
    """

    def __init__(
        self, config: CodecConfig, receiver: ReceiverConfig, extractor: AdaptedExtractor | None = None
    ) -> None:
        """extractor: third-party extractor, see `adapted_sender`; None for the one that the configuration describes.

        Raises ModelError for an unknown extractor or ablation.
        """
        super().__init__()
        if not set(config.ablation.split()) <= {NO_CONTEXT, NO_FEEDBACK}:
            raise ModelError(f"There is no ablation '{config.ablation}'; choose {NO_CONTEXT} or {NO_FEEDBACK}.")
        self.config = config
        # An `Extractor`; Any, because calling a module has no type.
        self.extractor: Any = extractor or EXTRACTORS[type(config)](config, receiver.state_channels)
        feedback = FeedbackExtractor if receiver.kind.has_depth_feedback else PictureFeedbackExtractor
        self.feedback = feedback(config, receiver)
        self.analysis = Analysis(config, receiver)
        self.hyper_analysis = HyperAnalysis(receiver)
        self.steps = _step_network(config, receiver)
        self.sharp_steps = _step_network(config, receiver) if config.has_sharp_steps else None


def _step_network(config: CodecConfig, receiver: ReceiverConfig) -> StepNetwork | None:
    if not config.step_channels:
        return None
    return StepNetwork(receiver.latent_channels, receiver.state_channels, config.step_channels)
