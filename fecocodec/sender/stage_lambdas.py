"""Allocation of lambda to the stages."""

from typing import TypeVar

from jaxtyping import Int
from torch import Tensor

from fecocodec.config import PAPER, ReceiverConfig
from fecocodec.container import EXCESS_UNIT

STAGE_1_OFFSET = 229  # in units of the header, EXCESS_UNIT steps of lambda_q each: a factor of 6
LambdaQ = TypeVar("LambdaQ", int, Int[Tensor, " batch"])


def stage_1_offset(config: ReceiverConfig) -> int:
    """Return the offset of lambda of stage 1: 0 with the method "paper", which codes all stages at one lambda."""
    return 0 if config.method == PAPER else STAGE_1_OFFSET


def stage_lambdas(lambda_q: LambdaQ, num_stages: int, offset: int = STAGE_1_OFFSET) -> list[LambdaQ]:
    """Return the quantised lambda of each stage. lambda_q: quantised lambda of the last stage.

    offset: see `stage_1_offset`. If stage 2 follows, lambda of stage 1 is by default six times larger: stage 2 corrects
    the errors of stage 1, so bits of stage 1 are worth less (docs/what_we_learned.md).
    """
    if num_stages == 1:
        return [lambda_q]
    return [lambda_q + EXCESS_UNIT * offset] + [lambda_q] * (num_stages - 1)
