"""A network that proposes the steps of latent optimisation, from the gradient and the latents.

Such learned optimisers follow Andrychowicz et al., "Learning to learn by gradient descent by gradient descent", 2016.
Its loss in training also contains other views than the context views, which encoding does not see. So its steps overfit
the context views less than the plain gradient does (`training/step_learning.py`).
"""

import copy

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.grid import LATENTS
from fecocodec.layers.blocks import (
    CONDITION_CHANNELS,
    BlockChain,
    PointwiseConv2d,
    RateCondition,
    RowsLinear,
    downsample,
)
from fecocodec.receiver.state import Features, Latents

LARGEST_LOG_SCALE = 3.0  # of the gradient's part of a step
ERROR_SCALE = 4.0  # errors are small against 1


class StepNetwork(nn.Module):
    """(gradients, y, previous step, steps left, errors, F_k, S_{k-1}; condition) -> step of the latents, at 1/8.

    A step is the output of 2D blocks minus the scaled gradient. Before training it is the negative gradient, because
    the last layers start at zero.
    """

    def __init__(self, latent_channels: int, state_channels: int, width: int) -> None:
        super().__init__()
        self.join = PointwiseConv2d(4 * latent_channels + 1, width)
        self.errors = PointwiseConv2d(3 * LATENTS**2, width)
        self.known = downsample(2 * state_channels, width)
        self.blocks = BlockChain(width, width, 4)
        self.output = nn.Conv2d(width, latent_channels, 3, padding=1)
        self.log_scale = RowsLinear(CONDITION_CHANNELS, latent_channels)
        for layer in (self.output, self.log_scale):
            nn.init.zeros_(layer.weight)
            nn.init.zeros_(layer.get_parameter("bias"))

    def blended(self, other: "StepNetwork", share: float) -> "StepNetwork":
        """Return the network whose weights are (1 - share) times these and share times the other's."""
        if share == 0.0:
            return self
        network, others = copy.deepcopy(self), other.state_dict()
        network.load_state_dict({name: torch.lerp(own, others[name], share) for name, own in self.state_dict().items()})
        return network

    def prepare(
        self, features: Features, state: Float[Tensor, "item channel _ _"]
    ) -> Float[Tensor, "item width h8 w8"]:
        """Return the argument `known`, which is the same in all steps of a stage. features: F_k. state: S_{k-1}."""
        known: Tensor = self.known(torch.cat((features, state.expand(-1, -1, *features.shape[-2:])), dim=1))
        return known

    def forward(
        self,
        gradient: Latents,
        of_rate: Latents,
        y: Latents,
        previous: Latents,
        left: float,
        errors: Float[Tensor, "item 3 h w"],
        known: Float[Tensor, "item width h8 w8"],
        condition: RateCondition,
    ) -> Latents:
        """Return the proposed step; the caller multiplies it by the present length of steps.

        gradient: of the objective, with an RMS of 1. of_rate: gradient of the rate term, on the same scale. previous:
        what was returned for the step before, zero at first. left: share of the steps that remain, with this one.
        errors: photographs minus renderings, sRGB. known: see `prepare`.
        """
        compressed = torch.sign(y) * torch.log1p(y.abs())  # the range of y varies by decades with lambda
        gradients = (torch.asinh(gradient), torch.asinh(of_rate))
        inputs = (*gradients, compressed, previous, torch.full_like(gradient[:, :1], left))
        seen = self.errors(F.pixel_unshuffle(ERROR_SCALE * errors, LATENTS))
        added = self.output(self.blocks(self.join(torch.cat(inputs, dim=1)) + seen + known, condition))
        log_scale = self.log_scale(condition.embedding).clamp(-LARGEST_LOG_SCALE, LARGEST_LOG_SCALE)
        step: Tensor = added - log_scale.exp()[:, :, None, None] * gradient
        return step
