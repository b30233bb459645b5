"""Inputs and results of a coding stage, and what a pass over the stages is given: a coder and improvements."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar, runtime_checkable

from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.layers.blocks import RateCondition
from fecocodec.progress import Progress
from fecocodec.rendering.rasterizer import Rendering
from fecocodec.sender.fading import Fade, Fading
from fecocodec.splatting.emission import Prediction


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
    y_hat: Float[Tensor, "item latent h8 w8"] | None
    fading: Fading | None = None


@runtime_checkable
class CodedLatent(Protocol):
    """Latent after coding. Coders add further fields, such as bytes or estimated bits."""

    @property
    def y_hat(self) -> Float[Tensor, "item latent h8 w8"]: ...


Coded = TypeVar("Coded", bound=CodedLatent)
LatentCoder = Callable[[Float[Tensor, "item latent h8 w8"], StageInputs], Coded]
Optimise = Callable[
    [Float[Tensor, "item latent h8 w8"], Float[Tensor, "item channel h4 w4"], StageInputs, Progress],
    Float[Tensor, "item latent h8 w8"],
]


def as_analysed(y: Tensor, features: Tensor, inputs: StageInputs, progress: Progress) -> Tensor:
    """Return the output of the analysis transform unchanged."""
    return y


@dataclass(frozen=True)
class Improvements:
    """What this codec adds to the paper's stages. The defaults add nothing.

    latent: (y, F_k, inputs, progress) -> y before coding. fading: (Gaussians after a stage, fading before it) ->
    fading; None for no fading.
    """

    latent: Optimise = as_analysed
    fading: Fade | None = None


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
    y: Float[Tensor, "item latent h8 w8"]
    coded: Coded
    state: Float[Tensor, "item channel h4 w4"]
    feedback: StageRendering | None
    fading: Fading | None = None
