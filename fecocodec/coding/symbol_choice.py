"""Which symbol is sent for a latent: not always the nearest.

Rate-distortion optimised quantisation, as senders of video have it: the neighbour on the side of the mean, which is
more probable, takes the nearest symbol's place where it saves more bits than the larger error is worth. Only senders
choose; a receiver takes whatever symbol comes.
"""

import math

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.container.lagrangian import LAMBDA_Q_MAX
from fecocodec.entropy.tables import (
    NARROW_SIGMA,
    SIGMA_ONE_INDEX,
    SYMBOL_LIMIT,
    TABLES_PER_OCTAVE,
    WIDE_SHARE,
    WIDE_SIGMA,
)

# What a bit is worth in stage 1 and 2, in squared quantisation steps, at lambda 1e-5 and 1e-2, as measured
# (docs/experiments.md). Where steps are fine against what they quantise a bit divides the squared error by four:
# 2 ln(2) / 12 = 0.12. What stage 1 gets wrong stage 2 mends.
PRICES = {1: (0.35, 0.16), 2: (0.3, 0.05)}
_TAIL_IN_SIGMAS = 8.0  # beyond it the wide Gaussian continues as an exponential: float32 and gradients stay finite
_TAIL_SLOPE = _TAIL_IN_SIGMAS / WIDE_SIGMA**2  # of -ln(mass) there, per standard deviation of the table
_MOST_BITS = 32.0  # about what an outlier costs, by the least frequency of a table or by an escape


def price_of_bits(lambda_q: Int[Tensor, " item"], stage: int) -> Float[Tensor, " item"]:
    """In squared quantisation steps; linear in ln(lambda), also above 1e-2."""
    finest, coarsest = PRICES[stage]
    return finest + (coarsest - finest) * lambda_q / LAMBDA_Q_MAX


@torch.no_grad()
def choose_symbols(
    residual: Float[Tensor, "*shape"], table_index: Float[Tensor, "*shape"], price: Float[Tensor, "*broadcast"]
) -> Float[Tensor, "*shape"]:
    """Integers within +-`SYMBOL_LIMIT`: the nearest to the residual (value - mean), or the next one towards zero."""
    nearest = (residual + 0.5).floor().clamp(-SYMBOL_LIMIT, SYMBOL_LIMIT)
    smaller = nearest - nearest.sign()
    bits, bits_of_smaller = symbol_bits(torch.stack((nearest, smaller)), table_index)
    added = (residual - smaller).square() - (residual - nearest).square()
    return torch.where(added < price * (bits - bits_of_smaller), smaller, nearest)


def symbol_bits(residual: Float[Tensor, "*shape"], table_index: Float[Tensor, "*broadcast"]) -> Float[Tensor, "*shape"]:
    """-log2 of the mass of [residual - 1/2, residual + 1/2] under the mixture of a table, or between two tables."""
    inverse_sigma = torch.exp((SIGMA_ONE_INDEX - table_index) * (math.log(2.0) / TABLES_PER_OCTAVE))
    distance = residual.abs()
    core = torch.minimum(distance, 0.5 + _TAIL_IN_SIGMAS / inverse_sigma.detach())
    narrow, wide = (_mass_around(core, inverse_sigma / sigma) for sigma in (NARROW_SIGMA, WIDE_SIGMA))
    mass = (1.0 - WIDE_SHARE) * narrow + WIDE_SHARE * wide
    nats = (distance - core) * inverse_sigma * _TAIL_SLOPE - torch.log(mass)
    bits = nats / math.log(2.0)
    return bits - (bits - bits.clamp(max=_MOST_BITS)).detach()


def _mass_around(
    distance: Float[Tensor, "*shape"], inverse_sigma: Float[Tensor, "*broadcast"]
) -> Float[Tensor, "*shape"]:
    """Mass of a Gaussian within half a step of a distance from its mean."""
    scale = math.sqrt(0.5) * inverse_sigma
    return 0.5 * (torch.erfc((distance - 0.5) * scale) - torch.erfc((distance + 0.5) * scale))
