"""The synthesis transform and the state update as one graph."""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from fecocodec.coding.fixed_point import ONE_Q8
from fecocodec.coding.quadtree import from_coding_order
from fecocodec.layers.blocks import RateCondition
from fecocodec.receiver.model import Receiver
from fecocodec.training.graphs.channels_last import upsampled


def rate_condition(receiver: Receiver, lambda_q: Tensor, stage: Tensor) -> RateCondition:
    """Return the condition of one stage for all views, with one item. lambda_q, stage: int32 scalars."""
    first, second = (receiver.condition(lambda_q[None], number) for number in (1, 2))
    return RateCondition(torch.where(stage == 1, first.embedding, second.embedding), first.latent_gain)


class UpdateGraph(nn.Module):
    """Four steps of y, state before, lambda_q, stage -> state. The state before stage 1 may have any values."""

    def __init__(self, receiver: Receiver) -> None:
        super().__init__()
        self.receiver = receiver

    def forward(
        self,
        step_0: Tensor,
        step_1: Tensor,
        step_2: Tensor,
        step_3: Tensor,
        state: Tensor,
        lambda_q: Tensor,
        stage: Tensor,
    ) -> Tensor:
        y_hat = from_coding_order(torch.stack((step_0, step_1, step_2, step_3)).float() / ONE_Q8)
        before = torch.where(stage == 1, self.receiver.update.initial_state, state)
        condition = rate_condition(self.receiver, lambda_q, stage)
        synthesis, update = self.receiver.synthesis, self.receiver.update
        coarse = synthesis.coarse(synthesis.input(y_hat / condition.latent_gain), condition)
        of_state, of_features = update.join.weight.chunk(2, dim=1)
        of_latent, of_before = self._upsampled_and_joined(coarse, of_features[:, :, 0, 0]), F.conv2d(before, of_state)
        # The sum has channels last, as the layer normalisation that follows.
        joined = (of_latent.permute(0, 2, 3, 1) + of_before.permute(0, 2, 3, 1)).permute(0, 3, 1, 2)
        after: Tensor = update.block(joined, condition)
        return after

    def _upsampled_and_joined(self, coarse: Tensor, of_features: Tensor) -> Tensor:
        """Return the part of the joining convolution that depends on g_s(y_hat), with its bias.

        The convolution of g_s before its pixel shuffle and the joining one are linear, so their product is one layer,
        which runtimes compute when they load the graph.
        """
        up, join = self.receiver.synthesis.up[0], self.receiver.update.join
        assert isinstance(up, nn.Conv2d)
        assert up.bias is not None
        assert join.bias is not None
        of_pixels = up.weight.flatten(1).unflatten(0, (-1, 4)).flatten(1)  # [channel, (pixel in)]
        weight = (of_features @ of_pixels).reshape(up.weight.shape[:2])
        bias = of_features @ up.bias.unflatten(0, (-1, 4)) + join.bias[:, None]
        return upsampled(coarse, weight, bias.flatten())
