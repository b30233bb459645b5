"""Inputs and results of a coding stage, and what a pass over the stages gets: coders of latents and improvements."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar, runtime_checkable

from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.coding.payload import encode_latents
from fecocodec.coding.rate import estimate_latents, rounding, straight_through
from fecocodec.coding.symbol_choice import no_price, price_of_bits
from fecocodec.layers.blocks import RateCondition
from fecocodec.progress import Progress
from fecocodec.receiver.state import Features, Latents
from fecocodec.rendering.rasterizer import Rendering
from fecocodec.sender.codec import Codec
from fecocodec.sender.fading import Fade, Fading
from fecocodec.splatting.emission import Prediction

TIME_OF_CODING, TIME_OF_FADING = 0.6, 1.4  # steps of the latents; 2 to 16 coded views, 0 to 12 guides


@dataclass(frozen=True)
class StageInputs:
    """Information available to sender and receiver before stage k; item = (batch view).

    stage: 1 or 2, the stage that networks are conditioned on. is_last: whether no stage follows. lambda_q: quantised
    lambda of this stage. state: S_{k-1}; its spatial size is 1x1 if it is the same at every position. y_hat: coded
    latent of stage k - 1, None in stage 1. fading: found after stage k - 1, None for none.
    """

    stage: int
    is_last: bool
    lambda_q: Int[Tensor, " item"]
    condition: RateCondition
    state: Float[Tensor, "item channel _ _"]
    y_hat: Latents | None
    fading: Fading | None = None


@runtime_checkable
class CodedLatent(Protocol):
    """Latent after coding. Coders add further fields, such as bytes or estimated bits."""

    @property
    def y_hat(self) -> Latents: ...


Coded = TypeVar("Coded", bound=CodedLatent)
LatentCoder = Callable[[Latents, StageInputs], Coded]
Optimise = Callable[
    [Latents, Features, StageInputs, Progress],
    Latents,
]


def as_analysed(y: Tensor, features: Tensor, inputs: StageInputs, progress: Progress) -> Tensor:
    """Return the output of the analysis transform unchanged."""
    return y


@dataclass(frozen=True)
class Improvements:
    """What this codec adds to the paper's stages. The defaults add nothing.

    latent: (y, F_k, inputs, progress) -> y before coding. fading: (Gaussians after a stage, fading before it,
    progress) -> fading; None for no fading. num_steps: of the latents, in the stages before the last, and in the last.
    """

    latent: Optimise = as_analysed
    fading: Fade | None = None
    num_steps: tuple[int, int] = (0, 0)

    def times(self, num_stages: int) -> tuple[float, ...]:
        """Return two times of each stage, up to its coding and of its fading, relative to a step of the latents."""
        first, last = self.num_steps
        of_fading = TIME_OF_FADING if self.fading is not None else 0.0
        return (TIME_OF_CODING + first, of_fading) * (num_stages - 1) + (TIME_OF_CODING + last, of_fading)


NO_IMPROVEMENTS = Improvements()


@dataclass(frozen=True)
class StageRendering:
    """Prediction after a stage, and its rendering of each scene, context views first."""

    prediction: Prediction
    scenes: tuple[Rendering, ...]


@dataclass(frozen=True)
class Stage(Generic[Coded]):
    """Result of stage k. y: latent before coding. state: S_k. feedback: rendering of stage k - 1, None in stage 1.

    fading: of the Gaussians of this stage, None for none.
    """

    inputs: StageInputs
    y: Latents
    coded: Coded
    state: Features
    feedback: StageRendering | None
    fading: Fading | None = None


@dataclass(frozen=True)
class WrittenLatent:
    """Coded latent of one stage. payload: entropy-coded y and z. digest: of the symbols, stored in the header."""

    y_hat: Float[Tensor, "view latent h8 w8"]
    payload: bytes
    digest: bytes


@dataclass(frozen=True)
class EstimatedLatent:
    """Quantised latent with straight-through gradients. bits: estimated number of bits of each item."""

    y_hat: Latents
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
