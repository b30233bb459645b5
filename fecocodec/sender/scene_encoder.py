"""The pass over the stages: stage I and stage II of the paper, for one scene or a batch of scenes.

Encoding, rate control, training, the entropy phase, ablations and the uncoded upper bound all run this pass. They
differ in how a latent is coded (bytes, noise, not at all) and in what is done to it before (nothing, optimisation).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

import torch
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.layers.blocks import RateCondition
from fecocodec.receiver.decode import OnProgress
from fecocodec.receiver.predictor import Prediction
from fecocodec.rendering.rasterizer import Rendering, render
from fecocodec.sender.codec import Codec
from fecocodec.sender.matched_depth import depth_feedback
from fecocodec.sender.stage_lambdas import stage_lambdas


@dataclass(frozen=True)
class StageInputs:
    """What both ends know before stage k; item = (batch view).

    stage: 1 or 2, as networks are conditioned on it. is_last: no stage follows. state: S_{k-1}, at every position or a
    single one that stands for all. y_hat: of stage k - 1, None in stage 1.
    """

    stage: int
    is_last: bool
    lambda_q: Int[Tensor, " item"]
    condition: RateCondition
    state: Float[Tensor, "item channel _ _"]
    y_hat: Float[Tensor, "item latent h8 w8"] | None


@runtime_checkable
class CodedLatent(Protocol):
    """A latent after coding, with whatever the coder adds: bytes, estimated bits."""

    @property
    def y_hat(self) -> Float[Tensor, "item latent h8 w8"]: ...


Coded = TypeVar("Coded", bound=CodedLatent)
LatentCoder = Callable[[Float[Tensor, "item latent h8 w8"], StageInputs], Coded]
Optimise = Callable[[Float[Tensor, "item latent h8 w8"], StageInputs], Float[Tensor, "item latent h8 w8"]]


@dataclass(frozen=True)
class StageRendering:
    """The Gaussians predicted after a stage, and their rendering of each scene, context views first."""

    prediction: Prediction
    scenes: tuple[Rendering, ...]


@dataclass(frozen=True)
class Stage(Generic[Coded]):
    """Stage k after coding. y: before coding. state: S_k. feedback: rendering of stage k - 1, None in stage 1."""

    inputs: StageInputs
    y: Float[Tensor, "item latent h8 w8"]
    coded: Coded
    state: Float[Tensor, "item channel h4 w4"]
    feedback: StageRendering | None


def not_optimised(y: Tensor, inputs: StageInputs) -> Tensor:
    """The latent as the analysis transform gives it."""
    return y


class SceneEncoder:
    """Codec, photographs and cameras, and what does not depend on lambda: matching and F1, computed once.

    images [batch view 3 h w] -> E_mv -> F1 -> g_a(., S0) -> y1 -> coder -> y1_hat -> U(S0, g_s(.)) -> S1
    S1 -> P -> rendering -> E_fb(I, .) -> F2 -> g_a(., S1) -> y2 -> coder -> y2_hat -> U(S1, g_s(.)) -> S2
    """

    def __init__(self, codec: Codec, images: Float[Tensor, "batch view 3 h w"], cameras: Cameras) -> None:
        """images: sRGB in [0, 1], sides multiples of 32. cameras: a batch of normalised scenes."""
        self.codec, self.images, self.cameras = codec, images, cameras

    @property
    def num_views(self) -> int:
        return self.images.shape[1]

    @property
    def size(self) -> tuple[int, int]:
        """(height, width) of the images."""
        return self.images.shape[-2], self.images.shape[-1]

    @property
    def num_pixels(self) -> int:
        """Of all views of all scenes."""
        return self.images[:, :, 0].numel()

    @cached_property
    def matching(self) -> Any:
        """What the extractor's matching returns: `relative_disparity` and `depth` (MatchedDepth)."""
        return self.codec.sender.extractor.match(self.images, self.cameras)

    @cached_property
    def features(self) -> Float[Tensor, "item channel h4 w4"]:
        """F1 = E_mv(I)."""
        features: Tensor = self.codec.sender.extractor.fuse(self.images, self.matching)
        return features

    def run(
        self,
        lambda_q: Int[Tensor, " batch"],
        num_stages: int,
        code: LatentCoder[Coded],
        optimise: Optimise = not_optimised,
        on_progress: OnProgress = lambda _task, _fraction: None,
    ) -> tuple[Stage[Coded], ...]:
        """Run the stages. A third stage and later ones, which streams cannot hold, work as the second does.

        lambda_q: of each scene's last stage. code: y, inputs -> object with `y_hat`. optimise: y, inputs -> better y.
        """
        on_progress("matching views", 0.0)
        features, state, y_hat = self.features, self.initial_state, None  # F1, S0
        stages: list[Stage[Coded]] = []
        for number, lambda_q_k in enumerate(stage_lambdas(lambda_q.to(self.images.device), num_stages), start=1):
            done = 0.1 + 0.9 * (number - 1) / num_stages
            kind, lambda_q_of_item = min(number, 2), lambda_q_k.repeat_interleave(self.num_views)
            condition = self.codec.receiver.condition(lambda_q_of_item, kind)
            rendering = None
            if stages:
                on_progress("rendering feedback", done)
                rendering = self.render(stages[-1])  # I1_hat, of G1 = P(S1)
                features = self.feedback(rendering, condition)  # F2 = E_fb(I, I1_hat)
            inputs = StageInputs(kind, number == num_stages, lambda_q_of_item, condition, state, y_hat)
            on_progress(f"optimising stage {number}", done + 0.1 / num_stages)
            y = optimise(self.analyse(features, inputs), inputs)  # y_k = g_a(F_k, S_{k-1})
            on_progress(f"coding stage {number}", done + 0.8 / num_stages)
            coded = code(y, inputs)
            y_hat, state = coded.y_hat, self.update(inputs, coded.y_hat)  # S_k = U(S_{k-1}, g_s(y_k_hat))
            stages.append(Stage(inputs, y, coded, state, rendering))
        return tuple(stages)

    @property
    def initial_state(self) -> Float[Tensor, "item channel 1 1"]:
        """S0, which is the same at every position."""
        return self.codec.receiver.update.start(self.images.shape[0] * self.num_views, 1, 1)

    def analyse(
        self, features: Float[Tensor, "item channel h4 w4"], inputs: StageInputs
    ) -> Float[Tensor, "item latent h8 w8"]:
        """y_k = g_a(concat(F_k, S_{k-1}))."""
        state = inputs.state.expand(-1, -1, *features.shape[-2:])
        y: Tensor = self.codec.sender.analysis(features, state, inputs.condition)
        return y

    def update(
        self, inputs: StageInputs, y_hat: Float[Tensor, "item latent h8 w8"]
    ) -> Float[Tensor, "item channel h4 w4"]:
        """S_k = U(S_{k-1}, g_s(y_hat_k))."""
        return self.codec.receiver.next_state(inputs.state, y_hat, inputs.condition)

    def predict(self, state: Float[Tensor, "item channel h4 w4"], condition: RateCondition) -> Prediction:
        """G_k = P(S_k) of all scenes."""
        return self.codec.receiver.predict(state, self.cameras, condition)

    def render(self, stage: Stage[Any]) -> StageRendering:
        """The context views as the receiver can render them after a stage; for a batch of one scene."""
        prediction, cameras = self.predict(stage.state, stage.inputs.condition), self.cameras.scene(0)
        gaussians = self.codec.receiver.appearance(prediction, cameras)
        return StageRendering(prediction, (render(gaussians, cameras, self.size),))

    def feedback(self, rendering: StageRendering, condition: RateCondition) -> Float[Tensor, "item channel h4 w4"]:
        """F_{k+1} = E_fb(I, I_k_hat, depth errors). No gradient flows back into the stage before."""
        rendered = torch.cat([scene.color[: self.num_views] for scene in rendering.scenes]).detach()
        disparity = rearrange(rendering.prediction.relative_disparity, "b v h w -> (b v) 1 h w")
        return self.features_of_errors(rendered, disparity, condition)

    def features_of_errors(
        self,
        rendered: Float[Tensor, "item 3 h w"],
        disparity: Float[Tensor, "item 1 h4 w4"],
        condition: RateCondition,
    ) -> Float[Tensor, "item channel h4 w4"]:
        """E_fb of the photographs against these renderings, and of matched against these relative disparities."""
        images = rearrange(self.images, "b v rgb h w -> (b v) rgb h w")
        errors = depth_feedback(self.matching.depth, disparity)
        features: Tensor = self.codec.sender.feedback(images, rendered, errors, condition)
        return features
