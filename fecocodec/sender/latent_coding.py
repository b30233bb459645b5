"""Latent coders for `SceneEncoder.run`: entropy coding to bytes, and a differentiable estimate of the rate."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from fecocodec.coding.payload import encode_latents
from fecocodec.coding.rate import estimate_latents, rounding, straight_through
from fecocodec.coding.symbol_choice import no_price, price_of_bits
from fecocodec.sender.codec import Codec
from fecocodec.sender.stages import LatentCoder, StageInputs


@dataclass(frozen=True)
class WrittenLatent:
    """Coded latent of one stage. payload: entropy-coded y and z. digest: of the symbols, stored in the header."""

    y_hat: Float[Tensor, "view latent h8 w8"]
    payload: bytes
    digest: bytes


@dataclass(frozen=True)
class EstimatedLatent:
    """Quantised latent with straight-through gradients. bits: estimated number of bits of each item."""

    y_hat: Float[Tensor, "item latent h8 w8"]
    bits: Float[Tensor, " item"]


def write_latents(codec: Codec) -> LatentCoder[WrittenLatent]:
    """Return a coder that codes y and z = h_a(y) of one scene to bytes. It raises InputError for a latent with NaN.

    Symbols are chosen by rate and distortion; a method without this choice rounds.
    """
    price = price_of_bits if codec.receiver.config.kind.has_symbol_choice else no_price

    def code(y: Tensor, inputs: StageInputs) -> WrittenLatent:
        z = codec.sender.hyper_analysis(y)
        lambda_q = int(inputs.lambda_q[0])
        payload, coded = encode_latents(codec.receiver.prior, y, z, lambda_q, inputs.stage, inputs.y_hat, price)
        return WrittenLatent(coded.y_hat, payload, coded.digest())

    return code


def estimate_bits(codec: Codec) -> LatentCoder[EstimatedLatent]:
    """Return a coder that estimates the bits of y by the prior, with straight-through gradients for the rounding.

    z is computed from a detached y, and its bits are not counted.
    """

    def code(y: Tensor, inputs: StageInputs) -> EstimatedLatent:
        z = codec.sender.hyper_analysis(y.detach())
        prior, lambda_q = codec.receiver.prior, inputs.lambda_q
        estimate = estimate_latents(prior, y, z, lambda_q, inputs.stage, inputs.y_hat, rounding(straight_through))
        return EstimatedLatent(estimate.y_hat, estimate.bits_y)

    return code
