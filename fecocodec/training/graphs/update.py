"""The synthesis transform and the state update as one graph."""

import torch
from torch import Tensor, nn

from fecocodec.coding.fixed_point import ONE_Q8
from fecocodec.coding.quadtree import from_coding_order
from fecocodec.layers.blocks import RateCondition
from fecocodec.receiver.model import Receiver


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
        return self.receiver.next_state(before, y_hat, rate_condition(self.receiver, lambda_q, stage))
