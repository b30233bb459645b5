"""The entropy model as graphs, one for each interval between two batches of symbols.

All values are Q8 integers. Values of a batch are 256 * symbol + mean. Means are int32, table indices uint8. Batches
of y have the layout [4 phases, view, row, column, quarter of the channels] of `coding.quadtree`.
"""

import torch
from einops import rearrange
from torch import Tensor, nn

from fecocodec.coding.fixed_point import ONE_Q8
from fecocodec.coding.priors import LAMBDA_Q_CENTRE, NUM_STAGES, EntropyParameters, LatentPrior
from fecocodec.coding.quadtree import from_coding_order, merge_passes


def _outputs(parameters: EntropyParameters) -> tuple[Tensor, Tensor]:
    return parameters.mean_q8.to(torch.int32), parameters.table_index().to(torch.uint8)


class _PriorGraph(nn.Module):
    def __init__(self, prior: LatentPrior) -> None:
        super().__init__()
        self.prior = prior


def _condition(lambda_q: Tensor, stage: Tensor) -> Tensor:
    """Return the condition of the entropy model, [1 4]. lambda_q, stage: int32 scalars."""
    is_stage = torch.stack([stage == number for number in range(1, NUM_STAGES + 1)]).double()
    return torch.cat((ONE_Q8 * is_stage, (lambda_q - LAMBDA_Q_CENTRE).double() * is_stage))[None]


class HyperGraph(_PriorGraph):
    """lambda_q, stage -> mean and table index of each channel of z, equal at all positions."""

    def forward(self, lambda_q: Tensor, stage: Tensor) -> tuple[Tensor, Tensor]:
        mean, table = _outputs(self.prior.hyper_parameters(_condition(lambda_q, stage), 1, 1))
        return mean.flatten(), table.flatten()


class FeaturesGraph(_PriorGraph):
    """lambda_q, z_hat -> features of stage 1, and the parameters of the first batch of y."""

    def forward(self, lambda_q: Tensor, z_hat: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        return _features(self.prior, lambda_q, 1, z_hat, None)


class ContextFeaturesGraph(_PriorGraph):
    """lambda_q, z_hat of stage 2 and the four steps of y of stage 1 -> the same for stage 2."""

    def forward(
        self,
        lambda_q: Tensor,
        z_hat: Tensor,
        context_0: Tensor,
        context_1: Tensor,
        context_2: Tensor,
        context_3: Tensor,
    ) -> tuple[Tensor, Tensor, Tensor]:
        y_hat = from_coding_order(torch.stack((context_0, context_1, context_2, context_3)))
        return _features(self.prior, lambda_q, 2, z_hat, rearrange(y_hat.double(), "n c h w -> n h w c"))


def _features(
    prior: LatentPrior, lambda_q: Tensor, stage: int, z_hat: Tensor, context: Tensor | None
) -> tuple[Tensor, Tensor, Tensor]:
    condition = _condition(lambda_q, torch.tensor(stage)).expand(z_hat.shape[0], -1)
    features = prior.features(z_hat.double(), condition, context)
    return features, *_outputs(prior.block_parameters(features, []))


class SecondPassGraph(_PriorGraph):
    """features, first pass -> parameters of the second pass."""

    def forward(self, features: Tensor, pass_0: Tensor) -> tuple[Tensor, Tensor]:
        return _outputs(self.prior.block_parameters(features, [pass_0.double()]))


class ThirdPassGraph(_PriorGraph):
    """features, first and second pass -> parameters of the third pass."""

    def forward(self, features: Tensor, pass_0: Tensor, pass_1: Tensor) -> tuple[Tensor, Tensor]:
        return _outputs(self.prior.block_parameters(features, [pass_0.double(), pass_1.double()]))


class FirstStepGraph(_PriorGraph):
    """features, the three passes -> step 0 as one array, and the parameters of step 1."""

    def forward(self, features: Tensor, pass_0: Tensor, pass_1: Tensor, pass_2: Tensor) -> tuple[Tensor, ...]:
        step_0 = merge_passes([pass_0, pass_1, pass_2])
        return step_0, *_outputs(self.prior.steps["1"]([features, self.prior.surroundings(step_0.double())]))


class SecondStepGraph(_PriorGraph):
    """features, steps 0 and 1 -> parameters of step 2."""

    def forward(self, features: Tensor, step_0: Tensor, step_1: Tensor) -> tuple[Tensor, Tensor]:
        return _step_parameters(self.prior, features, step_0, step_1)


class ThirdStepGraph(_PriorGraph):
    """features, steps 0 to 2 -> parameters of step 3."""

    def forward(self, features: Tensor, step_0: Tensor, step_1: Tensor, step_2: Tensor) -> tuple[Tensor, Tensor]:
        return _step_parameters(self.prior, features, step_0, step_1, step_2)


def _step_parameters(prior: LatentPrior, features: Tensor, *steps: Tensor) -> tuple[Tensor, Tensor]:
    around = [prior.surroundings(step.double()) for step in steps]
    return _outputs(prior.steps[str(len(steps))]([features, *around]))
