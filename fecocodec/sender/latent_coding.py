"""Latents to bytes, for `SceneEncoder.run`, and the differentiable estimate of the same for their optimisation."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from fecocodec.coding.payload import encode_latents
from fecocodec.coding.rate import estimate_latents, straight_through
from fecocodec.sender.codec import Codec
from fecocodec.sender.scene_encoder import LatentCoder, StageInputs


@dataclass(frozen=True)
class WrittenLatent:
    """Payload of one stage. digest: over its symbols, for the header."""

    y_hat: Float[Tensor, "view latent h8 w8"]
    payload: bytes
    digest: bytes


@dataclass(frozen=True)
class EstimatedLatent:
    """Latent after coding with gradients. bits: estimated, of each item."""

    y_hat: Float[Tensor, "item latent h8 w8"]
    bits: Float[Tensor, " item"]


def write_latents(codec: Codec) -> LatentCoder[WrittenLatent]:
    """Code y and z = h_a(y) of one scene to a payload. The coder raises InputError for a latent with NaN."""

    def code(y: Tensor, inputs: StageInputs) -> WrittenLatent:
        z = codec.sender.hyper_analysis(y)
        lambda_q = int(inputs.lambda_q[0])
        payload, coded = encode_latents(codec.receiver.prior, y, z, lambda_q, inputs.stage, inputs.y_hat)
        return WrittenLatent(coded.y_hat, payload, coded.digest())

    return code


def estimate_bits(codec: Codec) -> LatentCoder[EstimatedLatent]:
    """Bits of y as the prior estimates them, with gradients straight through the rounding; z has none."""

    def code(y: Tensor, inputs: StageInputs) -> EstimatedLatent:
        z = codec.sender.hyper_analysis(y.detach())
        prior, lambda_q = codec.receiver.prior, inputs.lambda_q
        estimate = estimate_latents(prior, y, z, lambda_q, inputs.stage, inputs.y_hat, straight_through)
        return EstimatedLatent(estimate.y_hat, estimate.bits_y)

    return code
