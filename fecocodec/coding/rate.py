"""Differentiable estimate of the rate, for training and latent optimisation; same coding order as the bitstream."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.coding.coding_order import in_layout, scan_latents, split_partitions
from fecocodec.coding.fixed_point import ONE_Q8, clamp_through, round_through
from fecocodec.coding.priors import EntropyParameters, LatentPrior, condition_vector
from fecocodec.coding.symbol_choice import choose_symbols, price_of_bits, symbol_bits
from fecocodec.entropy.tables import FIRST_CODED_TABLE, NUM_TABLES, SYMBOL_LIMIT

Softening = Callable[[Float[Tensor, "*shape"]], Float[Tensor, "*shape"]]
"""Differentiable replacement of rounding in the rate: `uniform_noise()` or `straight_through`."""

Surrogate = Callable[[Tensor, EntropyParameters, Tensor], tuple[Tensor, Tensor]]
"""(residuals, entropy parameters, price) -> symbols and their estimated bits, both differentiable.

residuals: latents minus the predicted means. price: of a bit, see `price_of_bits`. Made by `rounding` or
`additive_noise`.
"""


@dataclass(frozen=True)
class LatentEstimate:
    """Dequantised latents, with straight-through gradients, and their estimated bits per item."""

    y_hat: Float[Tensor, "item latent height_8 width_8"]
    z_hat: Float[Tensor, "item hyper height_32 width_32"]
    bits_y: Float[Tensor, " item"]
    bits_z: Float[Tensor, " item"]


def uniform_noise(generator: torch.Generator | None = None) -> Softening:
    """Return a softening that adds uniform noise in [-1/2, 1/2) (Ballé et al., ICLR 2018)."""

    def soften(residual: Tensor) -> Tensor:
        return residual + (torch.rand(residual.shape, generator=generator, device=residual.device) - 0.5)

    return soften


def straight_through(residual: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """Round to the nearest symbol, with the gradient of the value before rounding."""
    return round_through(residual, -SYMBOL_LIMIT, SYMBOL_LIMIT)


def rounding(soften: Softening) -> Surrogate:
    """Return the surrogate that chooses the symbols of the bitstream, with straight-through gradients.

    The symbols and the value of the bits do not depend on `soften`, only the gradient of the bits does.
    """

    def choose(residual: Tensor, parameters: EntropyParameters, price: Tensor) -> tuple[Tensor, Tensor]:
        index = clamp_through(parameters.table_position(), 0, NUM_TABLES - 1)
        skipped = index.detach() < FIRST_CODED_TABLE - 0.5
        symbols = choose_symbols(residual, index, price) + (residual - residual.detach())
        # The scale gets its gradient from the bits of the symbols that are sent, latent and mean from the softened
        # ones. Scales trained on noise stay too wide where nearly all symbols are zero, so that every zero costs bits.
        sent, softened = symbol_bits(
            torch.stack((symbols.detach(), soften(residual))), torch.stack((index, index.detach()))
        )
        bits = sent + (softened - softened.detach())
        return _zero_through(symbols, skipped), _zero_through(bits, skipped)

    return choose


def additive_noise(noise: Softening) -> Surrogate:
    """Return the surrogate of the paper's training: noisy values in place of symbols (Ballé et al., ICLR 2018).

    Values that streams do not code, because their scale is small, get noise and bits too. noise: `uniform_noise()`.
    """

    def add_noise(residual: Tensor, parameters: EntropyParameters, _price: Tensor) -> tuple[Tensor, Tensor]:
        noisy = noise(residual)
        return noisy, symbol_bits(noisy, clamp_through(parameters.table_position(), 0, NUM_TABLES - 1))

    return add_noise


def estimate_latents(
    prior: LatentPrior,
    y: Float[Tensor, "item latent height_8 width_8"],
    z: Float[Tensor, "item hyper height_32 width_32"],
    lambda_q: Int[Tensor, " item"],
    stage: int,
    context_y_hat: Float[Tensor, "item latent height_8 width_8"] | None,
    surrogate: Surrogate,
) -> LatentEstimate:
    """Quantise latents and estimate their bits per item (a view of a scene); differentiable in all inputs.

    With `rounding`, the estimate differs from the size of the payload by a fraction of a percent. With
    `additive_noise`, y_hat and z_hat are the noisy latents.

    lambda_q: quantised lambda of the stage, one per item. stage: 1 or 2. context_y_hat: y_hat of stage 1 in stage 2,
    else None.
    """
    partitions, price = split_partitions(y.float(), z.float()), price_of_bits(lambda_q, stage)
    estimated: list[Tensor] = []

    def exchange(partition: int, parameters: EntropyParameters) -> Tensor:
        residual = partitions[partition] - parameters.mean_q8 / ONE_Q8
        symbols, bits = surrogate(residual, parameters, in_layout(price, partition))
        estimated.append(bits)
        return symbols * ONE_Q8 + parameters.mean_q8

    context_q8 = None if context_y_hat is None else context_y_hat.float() * ONE_Q8
    size_32 = (z.shape[2], z.shape[3])
    latents = scan_latents(prior, condition_vector(lambda_q, stage), size_32, context_q8, exchange)
    bits_z, *bits_y = estimated
    return LatentEstimate(
        y_hat=latents.y_hat_q8 / ONE_Q8,
        z_hat=latents.z_hat_q8 / ONE_Q8,
        bits_y=torch.stack([bits.sum(dim=(0, 2, 3, 4)) for bits in bits_y]).sum(dim=0),
        bits_z=bits_z.sum(dim=(1, 2, 3)),
    )


def _zero_through(x: Tensor, mask: Tensor) -> Tensor:
    """Return x with masked elements set to zero, and the gradient of x everywhere.

    Elements that are not coded keep their gradients, so that their predicted scale still follows the latent and can
    rise above the threshold again.
    """
    return x - (x * mask).detach()
