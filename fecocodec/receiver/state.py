"""State S and its update U: implicit Gaussian state and decoded features -> next state."""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.config import ReceiverConfig
from fecocodec.layers.blocks import Block2d, RateCondition


@dataclass(frozen=True)
class State:
    """Implicit Gaussian state of all views after a stage, and the condition of that stage, for the predictor."""

    state: Float[Tensor, "view channel h4 w4"]
    condition: RateCondition


class StateUpdate(nn.Module):
    """concat(S, g_s(y_hat)) -> 1x1 conv -> 2D block -> next S, all at 1/4; also holds the learned start S0."""

    def __init__(self, config: ReceiverConfig) -> None:
        super().__init__()
        channels = config.state_channels
        self.initial_state = nn.Parameter(0.02 * torch.randn(1, channels, 1, 1))
        self.join = nn.Conv2d(2 * channels, channels, 1)
        self.block = Block2d(channels, config.fine_hidden)

    def start(self, num_items: int, height4: int, width4: int) -> Float[Tensor, "item channel h4 w4"]:
        """S0, the same at every position of every view."""
        return self.initial_state.expand(num_items, -1, height4, width4)

    def forward(
        self,
        state: Float[Tensor, "item channel _ _"],
        features: Float[Tensor, "item channel h4 w4"],
        condition: RateCondition,
    ) -> Float[Tensor, "item channel h4 w4"]:
        """The state may be a single position (`start(n, 1, 1)`), which stands for all.

        The 1x1 convolution of the concatenation is the sum of two: nothing is copied, and S0 costs nothing.
        """
        of_state, of_features = self.join.weight.chunk(2, dim=1)
        joined = F.conv2d(features, of_features, self.join.bias).add_(F.conv2d(state, of_state))
        return self.block(joined, condition)
