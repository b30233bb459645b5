"""The lambda of each stage."""

from typing import TypeVar

from jaxtyping import Int
from torch import Tensor

from fecocodec.container import EXCESS_UNIT

STAGE_1_OFFSET = 229  # 256 ln 6, in units of the header
LambdaQ = TypeVar("LambdaQ", int, Int[Tensor, " batch"])


def stage_lambdas(lambda_q: LambdaQ, num_stages: int) -> list[LambdaQ]:
    """Quantised lambda of each stage: `lambda_q`, but six times that lambda in a stage 1 that stage 2 follows.

    Stage 2 sees and corrects the errors of stage 1, so that its bits are worth less (docs/experiments.md).
    """
    if num_stages == 1:
        return [lambda_q]
    return [lambda_q + EXCESS_UNIT * STAGE_1_OFFSET] + [lambda_q] * (num_stages - 1)
