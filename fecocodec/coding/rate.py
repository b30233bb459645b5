"""Training's estimate of the same model: differentiable bits, on the very walk that writes and reads the bitstream."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.coding.fixed_point import ONE_Q8, clamp_through, round_through
from fecocodec.coding.priors import EntropyParameters, LatentPrior, condition_vector
from fecocodec.coding.symbol_choice import choose_symbols, price_of_bits, symbol_bits
from fecocodec.coding.walk import in_layout, split_partitions, walk_latents
from fecocodec.entropy.tables import FIRST_CODED_TABLE, NUM_TABLES, SYMBOL_LIMIT

Softening = Callable[[Float[Tensor, "*shape"]], Float[Tensor, "*shape"]]
"""What stands for rounding where the gradient of the rate is taken: `uniform_noise()` or `straight_through`."""


@dataclass(frozen=True)
class LatentEstimate:
    """Latents as the receiver will see them, with gradients straight through the rounding, and estimated bits."""

    y_hat: Float[Tensor, "item latent height_8 width_8"]
    z_hat: Float[Tensor, "item hyper height_32 width_32"]
    bits_y: Float[Tensor, " item"]
    bits_z: Float[Tensor, " item"]


def uniform_noise(generator: torch.Generator | None = None) -> Softening:
    """Additive noise in [-1/2, 1/2): its gradient tells of the symbols that small changes would lead to."""

    def soften(residual: Tensor) -> Tensor:
        return residual + (torch.rand(residual.shape, generator=generator, device=residual.device) - 0.5)

    return soften


def straight_through(residual: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """The symbols themselves, with the gradient of the value before rounding."""
    return round_through(residual, -SYMBOL_LIMIT, SYMBOL_LIMIT)


def estimate_latents(
    prior: LatentPrior,
    y: Float[Tensor, "item latent height_8 width_8"],
    z: Float[Tensor, "item hyper height_32 width_32"],
    lambda_q: Int[Tensor, " item"],
    stage: int,
    context_y_hat: Float[Tensor, "item latent height_8 width_8"] | None,
    soften: Softening,
) -> LatentEstimate:
    """Latents after coding and their estimated bits per item (a view of a scene), with gradients for all inputs.

    The bits are those of the bitstream to a fraction of a percent, whatever `soften` is.

    lambda_q: see `condition_vector`, one per item. stage: 1 or 2. context_y_hat: y_hat of stage 1 where stage is 2.
    """
    meter = _Meter(split_partitions(y.float(), z.float()), price_of_bits(lambda_q, stage), soften)
    context_q8 = None if context_y_hat is None else context_y_hat.float() * ONE_Q8
    size_32 = (z.shape[2], z.shape[3])
    walked = walk_latents(prior, condition_vector(lambda_q, stage), size_32, context_q8, meter.exchange)
    bits_z, *bits_y = meter.bits
    return LatentEstimate(
        y_hat=walked.y_hat_q8 / ONE_Q8,
        z_hat=walked.z_hat_q8 / ONE_Q8,
        bits_y=torch.stack([bits.sum(dim=(0, 2, 3, 4)) for bits in bits_y]).sum(dim=0),
        bits_z=bits_z.sum(dim=(1, 2, 3)),
    )


class _Meter:
    """In place of a port: chooses symbols, with gradients straight through, and keeps the bits of each partition."""

    def __init__(self, partitions: list[Tensor], price: Float[Tensor, " item"], soften: Softening) -> None:
        self.partitions, self.price, self.soften = partitions, price, soften
        self.bits: list[Tensor] = []

    def exchange(self, partition: int, parameters: EntropyParameters) -> Tensor:
        residual = self.partitions[partition] - parameters.mean_q8 / ONE_Q8
        index = clamp_through(parameters.table_position(), 0, NUM_TABLES - 1)
        skipped = index.detach() < FIRST_CODED_TABLE - 0.5
        chosen = choose_symbols(residual, index, in_layout(self.price, partition))
        symbols = chosen + (residual - residual.detach())
        # The table learns from the symbols as they will be, the latent and its mean from a rate with a gradient. Tables
        # that learn from noise stay wide where nearly all symbols are zero, and every zero then costs something.
        sent, softened = symbol_bits(
            torch.stack((symbols.detach(), self.soften(residual))), torch.stack((index, index.detach()))
        )
        bits = sent + (softened - softened.detach())
        self.bits.append(_zero_through(bits, skipped))
        return _zero_through(symbols, skipped) * ONE_Q8 + parameters.mean_q8


def _zero_through(x: Tensor, mask: Tensor) -> Tensor:
    """Zero where masked, with the gradient of x everywhere.

    An element that is not coded keeps the gradients of one that is: its scale goes on following the latent's spread, so
    that it is coded again once that spread is worth it.
    """
    return x - (x * mask).detach()
