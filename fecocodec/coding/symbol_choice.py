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
from fecocodec.entropy.tables import SIGMA_ONE_INDEX, SYMBOL_LIMIT, TABLES_PER_OCTAVE

# What a bit is worth, in squared quantisation steps, at lambda 1e-5 and 1e-2, as measured (docs/experiments.md). Where
# steps are fine against what they quantise a bit divides the squared error by four: 2 ln(2) / 12 = 0.12.
PRICE_FINEST, PRICE_COARSEST = 0.2, 0.01
_TAIL_IN_SIGMAS = 5.0  # beyond it the Gaussian continues as an exponential, so that float32 and gradients stay finite
_MOST_BITS = 32.0  # about what an outlier costs, by the least frequency of a table or by an escape


def price_of_bits(lambda_q: Int[Tensor, " item"]) -> Float[Tensor, " item"]:
    """In squared quantisation steps; linear in ln(lambda)."""
    return PRICE_FINEST + (PRICE_COARSEST - PRICE_FINEST) * lambda_q / LAMBDA_Q_MAX


@torch.no_grad()
def choose_symbols(
    residual: Float[Tensor, "*shape"], table_index: Float[Tensor, "*shape"], price: Float[Tensor, "*broadcast"]
) -> Float[Tensor, "*shape"]:
    """Integers within +-`SYMBOL_LIMIT`: the nearest to the residual (value - mean), or the next one towards zero."""
    nearest = (residual + 0.5).floor().clamp(-SYMBOL_LIMIT, SYMBOL_LIMIT)
    smaller = nearest - nearest.sign()
    saved = gaussian_bits(nearest, table_index) - gaussian_bits(smaller, table_index)
    added = (residual - smaller).square() - (residual - nearest).square()
    return torch.where(added < price * saved, smaller, nearest)


def gaussian_bits(residual: Float[Tensor, "*shape"], table_index: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """-log2 of the mass of [residual - 1/2, residual + 1/2] under the Gaussian of a table, or between two tables."""
    inverse_sigma = torch.exp((SIGMA_ONE_INDEX - table_index) * (math.log(2.0) / TABLES_PER_OCTAVE))
    distance = residual.abs()
    core = torch.minimum(distance, 0.5 + _TAIL_IN_SIGMAS / inverse_sigma.detach())
    mass = torch.special.ndtr((0.5 - core) * inverse_sigma) - torch.special.ndtr((-0.5 - core) * inverse_sigma)
    nats = (distance - core) * inverse_sigma * _TAIL_IN_SIGMAS - torch.log(mass)
    bits = nats / math.log(2.0)
    return bits - (bits - bits.clamp(max=_MOST_BITS)).detach()
