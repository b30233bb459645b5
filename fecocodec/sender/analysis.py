"""Analysis transform g_a (F, S -> y) and hyper-analysis h_a (y -> z)."""

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.config import CodecConfig, ReceiverConfig
from fecocodec.layers.blocks import Block2d, BlockChain, PointwiseConv2d, RateCondition, downsample

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

    def forward(
        self,
        features: Float[Tensor, "item channel h4 w4"],
        state: Float[Tensor, "item channel h4 w4"],
        condition: RateCondition,
    ) -> Float[Tensor, "item latent h8 w8"]:
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

    def forward(self, y: Float[Tensor, "item latent h8 w8"]) -> Float[Tensor, "item hyper h32 w32"]:
        compressed = torch.sign(y) * torch.log1p(y.abs())  # the range of y varies by decades with lambda
        return F.hardtanh(self.layers(compressed), -LARGEST_LATENT, LARGEST_LATENT)
