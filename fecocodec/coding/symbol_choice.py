"""Rate-distortion optimised quantisation, as in video encoders.

The next symbol towards zero is more probable than the nearest symbol. It is sent instead if the bits it saves outweigh
the added squared error. Only the sender chooses; the receiver decodes any symbol.
"""

import math
from collections.abc import Callable

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.container.lambda_quantisation import LAMBDA_Q_MAX
from fecocodec.entropy.tables import (
    NARROW_SIGMA,
    SIGMA_ONE_INDEX,
    SYMBOL_LIMIT,
    TABLES_PER_OCTAVE,
    WIDE_SHARE,
    WIDE_SIGMA,
)

# Price of a bit in squared quantisation steps, per stage, at lambda 1e-5 and 1e-2, as measured.
# At high rate one more bit divides the squared error by four, which gives 2 ln(2) / 12 = 0.12. The price is higher in
# stage 1, because stage 2 corrects its errors.
PRICES = {1: (0.35, 0.16), 2: (0.3, 0.05)}
_TAIL_IN_SIGMAS = 8.0  # beyond this the tail is exponential, so that float32 values and gradients stay finite
_TAIL_SLOPE = _TAIL_IN_SIGMAS / WIDE_SIGMA**2  # of -ln(mass) there, per standard deviation of the table
_MOST_BITS = 32.0  # about the cost of an outlier, coded at the least frequency of a table or as an escape


PriceOfBits = Callable[[Int[Tensor, " item"], int], Float[Tensor, " item"]]
"""(lambda_q, stage) -> price of a bit in squared quantisation steps: `price_of_bits`, or `no_price` for rounding."""


def no_price(lambda_q: Int[Tensor, " item"], stage: int) -> Float[Tensor, " item"]:
    """Return the price 0, with which `choose_symbols` rounds to the nearest integer, as the paper does."""
    return torch.zeros_like(lambda_q, dtype=torch.float32)


def price_of_bits(lambda_q: Int[Tensor, " item"], stage: int) -> Float[Tensor, " item"]:
    """Return the price of a bit in squared quantisation steps; linear in ln(lambda), extrapolated above 1e-2."""
    finest, coarsest = PRICES[stage]
    return finest + (coarsest - finest) * lambda_q / LAMBDA_Q_MAX


@torch.no_grad()
def choose_symbols(
    residual: Float[Tensor, "*shape"], table_index: Float[Tensor, "*shape"], price: Float[Tensor, "*broadcast"]
) -> Float[Tensor, "*shape"]:
    """Return the symbol of each residual (value - mean): the nearest integer or the next one towards zero.

    table_index: index of the frequency table, not necessarily an integer. price: see `price_of_bits`; broadcast to the
    residuals. Symbols are clamped to +-`SYMBOL_LIMIT`.
    """
    nearest = (residual + 0.5).floor().clamp(-SYMBOL_LIMIT, SYMBOL_LIMIT)
    smaller = nearest - nearest.sign()
    bits, bits_of_smaller = symbol_bits(torch.stack((nearest, smaller)), table_index)
    added = (residual - smaller).square() - (residual - nearest).square()
    return torch.where(added < price * (bits - bits_of_smaller), smaller, nearest)


def symbol_bits(residual: Float[Tensor, "*shape"], table_index: Float[Tensor, "*broadcast"]) -> Float[Tensor, "*shape"]:
    """Return the bits of each residual: -log2 of the mass of [residual - 1/2, residual + 1/2] under a table's mixture.

    table_index need not be an integer. The value is at most 32 bits; the gradient is that of the unclamped value.
    """
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
    """Return the mass of a Gaussian within +-1/2 of a point at this distance from its mean."""
    scale = math.sqrt(0.5) * inverse_sigma
    return 0.5 * (torch.erfc((distance - 0.5) * scale) - torch.erfc((distance + 0.5) * scale))
