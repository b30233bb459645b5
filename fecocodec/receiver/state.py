"""State S and its update U: S_k = U(concat(S_{k-1}, g_s(y_hat_k)))."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.config import ReceiverConfig
from fecocodec.layers.blocks import Block2d, PointwiseConv2d, RateCondition, pointwise

Features = Float[Tensor, "item channel h4 w4"]  # item = (batch view)
Latents = Float[Tensor, "item latent h8 w8"]  # decoded, y_hat


@dataclass(frozen=True)
class State:
    """State S of all views after a stage, and the rate condition of that stage, which the predictor also needs.

    detail: numbers of the detail layer, see `DetailBasis`; None for none.
    """

    state: Float[Tensor, "view channel h4 w4"]
    condition: RateCondition
    detail: Float[Tensor, "view plane h8 w8"] | None = None


class StateUpdate(nn.Module):
    """concat(S, g_s(y_hat)) -> 1x1 conv -> 2D block -> next S, all at 1/4; also has the learned initial state S0."""

    def __init__(self, config: ReceiverConfig) -> None:
        super().__init__()
        channels = config.state_channels
        self.initial_state = nn.Parameter(0.02 * torch.randn(1, channels, 1, 1))
        self.join = PointwiseConv2d(2 * channels, channels)
        self.block = Block2d(channels, config.fine_hidden)

    def start(self, num_items: int, height4: int, width4: int) -> Features:
        """Return S0, which is the same at every position of every view."""
        return self.initial_state.expand(num_items, -1, height4, width4)

    def forward(
        self, state: Float[Tensor, "item channel _ _"], features: Features, condition: RateCondition
    ) -> Features:
        """Return the next state. A state of spatial size 1x1 must be `start(n, 1, 1)`, the same for all items.

        The 1x1 convolution of the concatenation is computed as a sum of two, which avoids the copy.
        """
        if state.shape[-2:] == (1, 1):
            state = state[:1]
        of_state, of_features = self.join.weight.chunk(2, dim=1)
        joined = pointwise(features, of_features, self.join.bias).add_(pointwise(state, of_state))
        return self.block(joined, condition)
