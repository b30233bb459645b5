"""Run the coding stages (stage I and stage II of the paper) for one scene or a batch of scenes.

Used by encoding, rate control, training, the entropy phase, ablations and the uncoded upper bound. They differ in the
coder of the latents (bytes, additive noise, none) and in the optimisation of the latents before coding.
"""

from dataclasses import replace
from functools import cached_property, partial
from typing import Any

import torch
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.coding.visibility import is_filled_behind
from fecocodec.config import PAPER
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.layers.blocks import RateCondition
from fecocodec.receiver.background import append
from fecocodec.receiver.decode import OnProgress
from fecocodec.receiver.occluded import occluded_layer
from fecocodec.receiver.predictor import Prediction
from fecocodec.rendering.rasterizer import Rendering, render
from fecocodec.sender.codec import Codec
from fecocodec.sender.cut_out import BLACK, WHITE, CutOut, Pictures, cut_out_of
from fecocodec.sender.extractors.adapter import ConditionedAdapter
from fecocodec.sender.fading import Fade
from fecocodec.sender.matched_depth import depth_feedback
from fecocodec.sender.model import NO_CONTEXT, NO_FEEDBACK
from fecocodec.sender.scene import Scene
from fecocodec.sender.stage_lambdas import stage_1_offset, stage_lambdas
from fecocodec.sender.stages import (
    Coded,
    LatentCoder,
    Optimise,
    Stage,
    StageInputs,
    StageRendering,
    not_optimised,
)


class SceneEncoder:
    """Encoder of a batch of scenes. Matching and F1 do not depend on lambda and are computed once.

    images [batch view 3 h w] -> E_mv -> F1 -> g_a(., S0) -> y1 -> coder -> y1_hat -> U(S0, g_s(.)) -> S1
    S1 -> P -> rendering -> E_fb(I, .) -> F2 -> g_a(., S1) -> y2 -> coder -> y2_hat -> U(S1, g_s(.)) -> S2
    """

    def __init__(
        self,
        codec: Codec,
        images: Float[Tensor, "batch view 3 h w"],
        cameras: Cameras,
        cut_out: CutOut | None = None,
    ) -> None:
        """images: sRGB in [0, 1], sides multiples of 32. cameras: normalised, a batch. cut_out: of one scene."""
        self.codec, self.images, self.cameras, self.cut_out = codec, images, cameras, cut_out

    @staticmethod
    def of(codec: Codec, scene: Scene) -> "SceneEncoder":
        """Return the encoder of one scene."""
        cut_out = cut_out_of(scene, codec.receiver.config.gaussians_per_side)
        return SceneEncoder(codec, scene.images, scene.cameras, cut_out)

    @property
    def num_views(self) -> int:
        """Number of context views of each scene."""
        return self.images.shape[1]

    @property
    def size(self) -> tuple[int, int]:
        """(height, width) of the images."""
        return self.images.shape[-2], self.images.shape[-1]

    @property
    def num_pixels(self) -> int:
        """Number of pixels of all views of all scenes."""
        return self.images[:, :, 0].numel()

    @cached_property
    def matching(self) -> Any:
        """Output of the extractor's `match`; has at least `relative_disparity` and `depth` (MatchedDepth)."""
        return self.codec.sender.extractor.match(self.images, self.cameras)

    @cached_property
    def features(self) -> Float[Tensor, "item channel h4 w4"]:
        """F1 = E_mv(I)."""
        features: Tensor = self.codec.sender.extractor.fuse(self.images, self.matching)
        return features

    def features_at(self, condition: RateCondition) -> Float[Tensor, "item channel h4 w4"]:
        """Return F1 at a rate condition, on which only the paper's adapter of a third-party extractor depends."""
        extractor = self.codec.sender.extractor
        if isinstance(extractor, ConditionedAdapter):
            return extractor.fuse_at(self.matching, condition)
        return self.features

    def run(
        self,
        lambda_q: Int[Tensor, " batch"],
        num_stages: int,
        code: LatentCoder[Coded],
        optimise: Optimise = not_optimised,
        fade: Fade | None = None,
        on_progress: OnProgress = lambda _task, _fraction: None,
    ) -> tuple[Stage[Coded], ...]:
        """Run the stages and return their results.

        lambda_q: quantised lambda of the last stage of each scene. num_stages: streams hold at most two; later stages
        repeat the second. code: (y, inputs) -> coded latent with `y_hat`. optimise: (y, F_k, inputs, on_fraction) ->
        optimised y. fade: (Gaussians, fading before the stage) -> fading, called after each stage; None for no fading.
        """
        state, y_hat, fading = self.initial_state, None, None  # S0
        stages: list[Stage[Coded]] = []
        offset = stage_1_offset(self.codec.receiver.config)
        lambdas = stage_lambdas(lambda_q.to(self.images.device), num_stages, offset)
        for number, lambda_q_k in enumerate(lambdas, start=1):
            begin, end = _progress_of(number, num_stages)
            kind, lambda_q_of_item = min(number, 2), lambda_q_k.repeat_interleave(self.num_views)
            condition = self.codec.receiver.condition(lambda_q_of_item, kind)
            rendering = None
            if stages:
                on_progress("rendering feedback", begin)
                rendering = self.render(stages[-1])  # I1_hat, of G1 = P(S1)
                features = self.feedback(rendering, condition)  # F2 = E_fb(I, I1_hat)
            else:
                features = self.features_at(condition)  # F1 = E_mv(I)
            inputs = StageInputs(kind, number == num_stages, lambda_q_of_item, condition, state, y_hat, fading)
            on_progress(f"coding stage {number}", begin)
            y = self.analyse(features, inputs)  # y_k = g_a(F_k, S_{k-1})
            report = partial(_report_part, on_progress, f"optimising stage {number}", begin, end)
            y = optimise(y, features, inputs, report)
            on_progress(f"coding stage {number}", end)
            coded = code(y, inputs)
            y_hat, state = coded.y_hat, self.update(inputs, coded.y_hat)  # S_k = U(S_{k-1}, g_s(y_k_hat))
            if fade is not None:
                on_progress("fading what hides other views", end)
                fading = fade(self.emitted(self.gaussians(self.predict(state, condition))), fading)
            stages.append(Stage(inputs, y, coded, state, rendering, fading))
        return tuple(stages)

    @property
    def initial_state(self) -> Float[Tensor, "item channel 1 1"]:
        """S0. It is the same at every position, hence 1x1."""
        return self.codec.receiver.update.start(self.images.shape[0] * self.num_views, 1, 1)

    def analyse(
        self, features: Float[Tensor, "item channel h4 w4"], inputs: StageInputs
    ) -> Float[Tensor, "item latent h8 w8"]:
        """y_k = g_a(concat(F_k, S_{k-1})); S0 in place of S_{k-1} for a sender without context."""
        given = self.initial_state if self.codec.sender.config.ablation == NO_CONTEXT else inputs.state
        state = given.expand(-1, -1, *features.shape[-2:])
        y: Tensor = self.codec.sender.analysis(features, state, inputs.condition)
        return y

    def update(
        self, inputs: StageInputs, y_hat: Float[Tensor, "item latent h8 w8"]
    ) -> Float[Tensor, "item channel h4 w4"]:
        """S_k = U(S_{k-1}, g_s(y_hat_k))."""
        return self.codec.receiver.next_state(inputs.state, y_hat, inputs.condition)

    def predict(self, state: Float[Tensor, "item channel h4 w4"], condition: RateCondition) -> Prediction:
        """Return G_k = P(S_k) of all scenes."""
        return self.codec.receiver.predict(state, self.cameras, condition)

    def render(self, stage: Stage[Any]) -> StageRendering:
        """Render the context views as the receiver does after a stage. Requires a batch of one scene."""
        prediction = self.predict(stage.state, stage.inputs.condition)
        gaussians = self.emitted(self.gaussians(prediction))
        if stage.fading is not None:
            gaussians = stage.fading.faded(gaussians)
        gaussians = self.completed(gaussians, prediction)
        return StageRendering(prediction, (render(gaussians, self.cameras.scene(0), self.size, self.background),))

    def gaussians(self, prediction: Prediction) -> Gaussians:
        """Return all Gaussians with view-dependent colours. Requires a batch of one scene."""
        return self.codec.receiver.appearance(prediction, self.cameras.scene(0))

    def emitted(self, gaussians: Gaussians) -> Gaussians:
        """Return all Gaussians of a scene, with an opacity of 0 for those that a cut-out does not emit."""
        return gaussians if self.cut_out is None else self.cut_out.emitted(gaussians)

    @property
    def is_filled(self) -> bool:
        """Whether a decoder adds Gaussians behind near surfaces."""
        is_compact = self.codec.receiver.config.method != PAPER
        return is_compact and is_filled_behind(self.num_views, self.cut_out is not None)

    def completed(self, gaussians: Gaussians, prediction: Prediction, scene: int = 0) -> Gaussians:
        """Add the Gaussians behind near surfaces as a decoder does (`receiver/occluded.py`). No gradient reaches them.

        gaussians: all of one scene, with the opacities that are emitted. prediction: from which they come.
        """
        if not self.is_filled:
            return gaussians
        with torch.no_grad():
            plain = replace(prediction.gaussians.scene(scene), opacities=gaussians.opacities)
            layer = occluded_layer(plain, self.cameras.scene(scene), (self.size[0] // 2, self.size[1] // 2))
        return append(gaussians, layer)

    @property
    def background(self) -> tuple[float, float, float]:
        """What is behind the Gaussians in `images`, sRGB: cut-outs are on white."""
        return BLACK if self.cut_out is None else WHITE

    @property
    def photographs(self) -> Pictures:
        """What the pictures of one scene are compared with: the context views; of cut-outs on white, then on black."""
        return self.images[0] if self.cut_out is None else self.cut_out.photographs(self.images[0])

    def pictures(self, rendering: Rendering) -> Pictures:
        """Return the renderings of the context views on the backgrounds of `photographs`. rendering: on black."""
        return rendering.color if self.cut_out is None else self.cut_out.pictures(rendering)

    def feedback(self, rendering: StageRendering, condition: RateCondition) -> Float[Tensor, "item channel h4 w4"]:
        """F_{k+1} = E_fb(I, I_k_hat, depth errors). Gradients do not reach the previous stage.

        A sender without feedback gets its photographs as renderings, and no depth errors.
        """
        if self.codec.sender.config.ablation == NO_FEEDBACK:
            images = rearrange(self.images, "b v rgb h w -> (b v) rgb h w")
            return self.features_of_errors(images, self.matching.depth.relative_disparity, condition)
        rendered = torch.cat([scene.color[: self.num_views] for scene in rendering.scenes]).detach()
        disparity = rearrange(rendering.prediction.relative_disparity, "b v h w -> (b v) 1 h w")
        return self.features_of_errors(rendered, disparity, condition)

    def features_of_errors(
        self,
        rendered: Float[Tensor, "item 3 h w"],
        disparity: Float[Tensor, "item 1 h4 w4"],
        condition: RateCondition,
    ) -> Float[Tensor, "item channel h4 w4"]:
        """Apply E_fb. rendered: I_k_hat, sRGB in [0, 1]. disparity: relative disparity predicted after stage k."""
        images = rearrange(self.images, "b v rgb h w -> (b v) rgb h w")
        errors = depth_feedback(self.matching.depth, disparity)
        features: Tensor = self.codec.sender.feedback(images, rendered, errors, condition)
        return features


def _progress_of(number: int, num_stages: int) -> tuple[float, float]:
    """Return the fractions of all work before and after the optimisation of a stage.

    The last stage has twice as many steps as each earlier one, see `steps_of_first`.
    """
    before, own = number - 1, 2 if number == num_stages else 1
    return 0.1 + 0.9 * before / (num_stages + 1), 0.1 + 0.9 * (before + own) / (num_stages + 1)


def _report_part(on_progress: OnProgress, task: str, begin: float, end: float, fraction: float) -> None:
    """Report a fraction of a part of the work, which extends from `begin` to `end`."""
    on_progress(task, begin + (end - begin) * fraction)
