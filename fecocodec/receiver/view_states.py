"""The implicit Gaussian states of a scene's views, each updated by the stages that code its view."""

from dataclasses import dataclass

from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.layers.blocks import RateCondition
from fecocodec.receiver.model import Receiver


@dataclass(frozen=True)
class ViewStates:
    """States after some stage. condition: of each view in the last stage that coded it, for the predictor."""

    state: Float[Tensor, "view channel h4 w4"]
    condition: RateCondition


def update_views(
    receiver: Receiver,
    before: ViewStates | None,
    y_hat: Float[Tensor, "coded latent h8 w8"],
    lambda_q: Int[Tensor, " view"],
    stage: int,
    views: tuple[int, ...],
) -> ViewStates:
    """States after a stage that codes `views`; the other views' states and conditions stay as they were before.

    before: None in stage 1, which codes all views. y_hat: of the views coded, in their order.
    """
    condition = receiver.condition(lambda_q, stage)
    if before is None:
        start = receiver.update.start(len(lambda_q), 1, 1)
        return ViewStates(receiver.next_state(start, y_hat, condition), condition)
    if len(views) == len(lambda_q):
        return ViewStates(receiver.next_state(before.state, y_hat, condition), condition)
    chosen = list(views)
    updated = receiver.next_state(before.state[chosen], y_hat, select_condition(condition, views))
    state, embedding = before.state.clone(), before.condition.embedding.clone()
    state[chosen], embedding[chosen] = updated, condition.embedding[chosen]
    return ViewStates(state, RateCondition(embedding, condition.latent_gain))


def select_condition(condition: RateCondition, views: tuple[int, ...]) -> RateCondition:
    """The condition of these views only."""
    chosen = list(views)
    return RateCondition(condition.embedding[chosen], condition.latent_gain[chosen])


def select_context(
    context: Float[Tensor, "view latent h8 w8"] | None, views: tuple[int, ...]
) -> Float[Tensor, "coded latent h8 w8"] | None:
    """y_hat of the stage before, of the views that this stage codes; None stays None."""
    return None if context is None else context[list(views)]
