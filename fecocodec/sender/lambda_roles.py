"""The roles of lambda: from the one that the user chooses to those of stages, latents, detail, and prices of a bit.

| role | function |
|---|---|
| lambda of the latents of a stream with detail, which has a floor | `lambda_of_latents` |
| lambda of each stage; stage 1 of two has a larger one | `stage_lambdas` |
| price of a bit in the optimisation of latents | `price_of_rate` |
| price of a bit of detail | `price_of_detail` |
| quantisation step of detail | `detail_step` |

The price of a bit in the choice of symbols is a constant in squared quantisation steps (`coding/symbol_choice.py`),
because these steps follow lambda. Lambda is quantised: `lambda_q`, see `container/lambda_quantisation.py`.
"""

import math
from typing import TypeVar

from jaxtyping import Int
from torch import Tensor

from fecocodec.config import Method
from fecocodec.container import EXCESS_UNIT
from fecocodec.container.detail_section import MAX_DETAIL_STEP
from fecocodec.container.lambda_quantisation import LAMBDA_MAX, LAMBDA_Q_MAX, STEPS_PER_E

LambdaQ = TypeVar("LambdaQ", int, Int[Tensor, " batch"])

DETAIL_LAMBDA_Q = 1179  # lambda 1e-3: from it on a few views have no detail; below it, detail gets more steps
FULL_DETAIL_LAMBDA_Q = 871  # lambda 3e-4: above it, bits of detail cost more, so that files near 1e-3 have few of them
FINE_LAMBDA_Q = 589  # lambda 1e-4: below it, detail is quantised more finely
LEAST_LATENT_LAMBDA_Q = 1088  # lambda 7e-4: latents below detail are not coded at a smaller one; detail buys more
MANY_VIEWS = 4  # from so many on, there is detail at every lambda, at the price of other bits
# Guides show which detail helps new views; without guides, the same two numbers lower quality there.
LEAST_TAUGHT_LATENT_LAMBDA_Q, PRICE_OF_TAUGHT_DETAIL = 1413, 0.6  # lambda 2.5e-3; of the price of other bits
RATE_WEIGHT = 2.15  # price of a bit per pixel, in lambdas, at lambda 1e-2
PRICE_EXPONENT = 0.6  # of lambda below; under 1, because D of the context views gains more per bit than that of others
DETAIL_PRICE_EXPONENT = 1.15  # of lambda above FULL_DETAIL_LAMBDA_Q, beyond that of the price
DETAIL_STEP, DETAIL_STEP_EXPONENT = 0.3, 0.15  # quantisation step of detail, and its exponent of lambda when finer


def is_taught(num_views: int, num_guides: int) -> bool:
    """Whether detail of the views is found by what guides show between them, and takes bits from latents.

    Guides must be as many as the views: with half as many, one scene of eight lost 0.7 dB at new views.
    """
    return num_guides >= num_views >= MANY_VIEWS


def lambda_of_latents(num_views: int, num_guides: int, lambda_q: int) -> int:
    """Return the quantised lambda of the latents of a stream with detail."""
    least = LEAST_TAUGHT_LATENT_LAMBDA_Q if is_taught(num_views, num_guides) else LEAST_LATENT_LAMBDA_Q
    return max(lambda_q, least)


def stage_lambdas(lambda_q: LambdaQ, num_stages: int, offset: int = Method.stage_1_offset) -> list[LambdaQ]:
    """Return the quantised lambda of each stage. lambda_q: of the last stage. offset: `Method.stage_1_offset`."""
    if num_stages == 1:
        return [lambda_q]
    return [lambda_q + EXCESS_UNIT * offset] + [lambda_q] * (num_stages - 1)


def price_of_rate(lambda_q: int) -> float:
    """Return the price of a bit per pixel, in units of D. The lambda of stage 1 may exceed 1e-2."""
    return RATE_WEIGHT * LAMBDA_MAX * math.exp(PRICE_EXPONENT * (lambda_q - LAMBDA_Q_MAX) / STEPS_PER_E)


def price_of_detail(num_views: int, num_guides: int, lambda_q: int) -> float:
    """Return the price of a bit of detail per pixel, in units of D: lower where guides show what detail is worth.

    At lambda 1e-3 and above, latents of a few views buy more at target views; below 3e-4, both buy the same, and detail
    far more at context views.
    """
    if num_views >= MANY_VIEWS:
        return price_of_rate(lambda_q) * (PRICE_OF_TAUGHT_DETAIL if is_taught(num_views, num_guides) else 1.0)
    rise = math.exp(DETAIL_PRICE_EXPONENT * max(0, lambda_q - FULL_DETAIL_LAMBDA_Q) / STEPS_PER_E)
    return price_of_rate(lambda_q) * rise


def detail_step(lambda_q: int) -> int:
    """Return the index of the quantisation step of detail (FORMAT.md, section 8.4)."""
    step = DETAIL_STEP * 10.0 ** (-DETAIL_STEP_EXPONENT * decades_below(FINE_LAMBDA_Q, lambda_q))
    return min(MAX_DETAIL_STEP, max(0, round(-8.0 * math.log2(step))))


def decades_below(bound: int, lambda_q: int) -> float:
    """Return by how many powers of ten lambda is below that of `bound`, at least 0. Both are quantised."""
    return max(0, bound - lambda_q) / (STEPS_PER_E * math.log(10.0))
