"""Synthesis transform g_s: decoded latent y_hat (1/8) -> features (1/4)."""

from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.config import ReceiverConfig
from fecocodec.layers.blocks import BlockChain, RateCondition, upsample


class Synthesis(nn.Module):
    """y_hat (1/8) -> 3x3 conv -> 2D blocks at 1/8 -> upsample -> features (1/4).

    There is no block at 1/4, because the state update has one and a second one is slow.
    """

    def __init__(self, config: ReceiverConfig) -> None:
        super().__init__()
        width = config.synthesis_channels
        self.input = nn.Conv2d(config.latent_channels, width, 3, padding=1)
        self.coarse = BlockChain(width, width, config.synthesis_depth)
        self.up = upsample(width, config.state_channels)

    def forward(
        self, y_hat: Float[Tensor, "item latent h8 w8"], condition: RateCondition
    ) -> Float[Tensor, "item channel h4 w4"]:
        return self.up(self.coarse(self.input(y_hat / condition.latent_gain), condition))
