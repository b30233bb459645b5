"""A network that proposes the steps of latent optimisation, from the gradient and the latents.

Such learned optimisers follow Andrychowicz et al., "Learning to learn by gradient descent by gradient descent", 2016.
The network is trained for the error of views between and beside the context views, too, which encoding does not see, so
that its steps overfit less than the gradient of the context views does (`training/step_phase.py`).
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.layers.blocks import CONDITION_CHANNELS, BlockChain, PointwiseConv2d, RateCondition, RowsLinear

LARGEST_LOG_SCALE = 3.0  # of the gradient's part of a step


class StepNetwork(nn.Module):
    """(gradient, y, previous step) -> 1x1 conv -> 2D blocks -> what is added to the scaled gradient, at 1/8 resolution.

    Before training, steps follow the gradient, because the last layers start at zero.
    """

    def __init__(self, latent_channels: int, width: int) -> None:
        super().__init__()
        self.join = PointwiseConv2d(3 * latent_channels + 1, width)
        self.blocks = BlockChain(width, width, 2)
        self.output = nn.Conv2d(width, latent_channels, 3, padding=1)
        self.log_scale = RowsLinear(CONDITION_CHANNELS, latent_channels)
        for layer in (self.output, self.log_scale):
            nn.init.zeros_(layer.weight)
            nn.init.zeros_(layer.get_parameter("bias"))

    def forward(
        self,
        gradient: Float[Tensor, "item latent h8 w8"],
        y: Float[Tensor, "item latent h8 w8"],
        previous: Float[Tensor, "item latent h8 w8"],
        left: float,
        condition: RateCondition,
    ) -> Float[Tensor, "item latent h8 w8"]:
        """Return the step, in units of the length of the step at hand.

        gradient: of the objective, with an RMS of 1. previous: the step before, zero at first. left: share of all steps
        that is left, with this one.
        """
        compressed = torch.sign(y) * torch.log1p(y.abs())  # the range of y varies by decades with lambda
        inputs = (torch.asinh(gradient), compressed, previous, torch.full_like(gradient[:, :1], left))
        added = self.output(self.blocks(self.join(torch.cat(inputs, dim=1)), condition))
        log_scale = self.log_scale(condition.embedding).clamp(-LARGEST_LOG_SCALE, LARGEST_LOG_SCALE)
        step: Tensor = added - log_scale.exp()[:, :, None, None] * gradient
        return step
