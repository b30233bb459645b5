"""The coding stages (stage I and stage II of the paper) for one scene or a batch of scenes.

Used by encoding, rate control, training, ablations and the uncoded upper bound. They differ in the coder of the latents
(bytes, additive noise, none) and in the improvements, which the paper does not have.
"""

from copy import copy
from functools import cached_property
from typing import Any

import torch
from einops import rearrange
from jaxtyping import Bool, Float, Int
from torch import Tensor

from fecocodec.coding.visibility import is_filled_behind
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.layers.blocks import RateCondition
from fecocodec.progress import Progress
from fecocodec.receiver.state import Features, Latents
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.codec import Codec
from fecocodec.sender.coverage import BLACK, WHITE, CutOut, cut_out_of
from fecocodec.sender.extractors.protocol import Matching, depth_feedback
from fecocodec.sender.fading import Fading, fading_of_masks
from fecocodec.sender.lambda_roles import stage_lambdas
from fecocodec.sender.scene import Guides, Scene
from fecocodec.sender.stages import (
    NO_IMPROVEMENTS,
    Coded,
    Improvements,
    LatentCoder,
    Stage,
    StageInputs,
    StageRendering,
)
from fecocodec.sender.view_overlap import ViewOverlap, view_overlap
from fecocodec.splatting.emission import Emission, Prediction, emit


class SceneEncoder:
    """Encoder of a batch of scenes. Matching and F1 are computed once.

    images [batch view 3 h w] -> E_mv -> F1 -> g_a(., S0) -> y1 -> coder -> y1_hat -> U(S0, g_s(.)) -> S1
    S1 -> P -> rendering -> E_fb(I, .) -> F2 -> g_a(., S1) -> y2 -> coder -> y2_hat -> U(S1, g_s(.)) -> S2
    """

    def __init__(
        self,
        codec: Codec,
        images: Float[Tensor, "batch view 3 h w"],
        cameras: Cameras,
        cut_out: CutOut | None = None,
        guides: Guides | None = None,
        ignored: Bool[Tensor, "view h w"] | None = None,
    ) -> None:
        """images: sRGB in [0, 1], sides multiples of 32. cameras: normalised, a batch.

        cut_out, guides, ignored: of one scene; guides are photographs that are not coded, and ignored the pixels that
        masks mark.
        """
        self.codec, self.images, self.cameras, self.cut_out, self.guides = codec, images, cameras, cut_out, guides
        self.ignored, self.fading_of_masks = ignored, fading_of_masks(ignored)

    @classmethod
    def of(cls, codec: Codec, scene: Scene) -> "SceneEncoder":
        """Return the encoder of one scene."""
        cut_out = cut_out_of(scene, codec.receiver.config.gaussians_per_side)
        return cls(codec, scene.images, scene.cameras, cut_out, scene.guides, scene.ignored)

    def with_colours(self, guides: Guides | None) -> "SceneEncoder":
        """Return an encoder with other colours of the same guides; matching, which compares textures, is kept."""
        changed = copy(self)
        changed.guides = guides
        return changed

    def run(
        self,
        lambda_q: Int[Tensor, " batch"],
        num_stages: int,
        code: LatentCoder[Coded],
        improve: Improvements = NO_IMPROVEMENTS,
        progress: Progress = Progress(),  # noqa: B008 - frozen
    ) -> tuple[Stage[Coded], ...]:
        """Run the stages and return their results.

        lambda_q: quantised lambda of the last stage of each scene. num_stages: streams hold at most two; later stages
        repeat the second. code: (y, inputs) -> coded latent with `y_hat`.
        """
        offset = self.codec.receiver.config.kind.stage_1_offset
        lambdas = stage_lambdas(lambda_q.to(self.images.device), num_stages, offset)
        parts = iter(progress.split(*improve.times(num_stages)))
        stages: list[Stage[Coded]] = []
        for number, (lambda_k, part, of_fade) in enumerate(zip(lambdas, parts, parts, strict=True), start=1):
            inputs = self.inputs_of(stages, lambda_k, number == num_stages)
            if stages:
                part("rendering feedback")
                feedback = self.render(stages[-1])  # I_k_hat, of G_k = P(S_k)
                features = self.feedback(feedback, inputs.condition)  # F_{k+1} = E_fb(I, I_k_hat)
            else:
                part("coding stage 1")
                feedback, features = None, self.features(inputs.condition)  # F1 = E_mv(I, P)
            stages.append(self.code_stage(features, inputs, code, improve, (part, of_fade), feedback))
        return tuple(stages)

    def code_stage(
        self,
        features: Features,
        inputs: StageInputs,
        code: LatentCoder[Coded],
        improve: Improvements,
        progress: tuple[Progress, Progress],
        feedback: StageRendering | None,
    ) -> Stage[Coded]:
        """Run stage k from F_k and S_{k-1}."""
        y = self.analyse(features, inputs)  # y_k = g_a(concat(F_k, S_{k-1}))
        of_latent, of_fade = progress
        y = improve.latent(y, features, inputs, of_latent)
        of_latent(f"coding stage {inputs.stage}", 1.0)
        coded = code(y, inputs)
        state = self.update(inputs, coded.y_hat)  # S_k = U(concat(S_{k-1}, g_s(y_k_hat)))
        fading = inputs.fading
        if improve.fading is not None:
            fading = improve.fading(self.emit(self.predict(state, inputs.condition), is_filled=False), fading, of_fade)
        return Stage(inputs, y, coded, state, feedback, fading)

    def inputs_of(self, stages: list[Stage[Coded]], lambda_q: Int[Tensor, " batch"], is_last: bool) -> StageInputs:
        """Return what is available before the stage that follows `stages`."""
        kind, of_item = min(len(stages) + 1, 2), lambda_q.repeat_interleave(self.num_views)
        condition = self.codec.receiver.condition(of_item, kind)
        if not stages:
            return StageInputs(kind, is_last, of_item, condition, self.initial_state, None, self.fading_of_masks)  # S0
        before = stages[-1]
        return StageInputs(kind, is_last, of_item, condition, before.state, before.coded.y_hat, before.fading)

    @property
    def num_views(self) -> int:
        return self.images.shape[1]

    @property
    def size(self) -> tuple[int, int]:
        return self.images.shape[-2], self.images.shape[-1]

    @property
    def num_pixels(self) -> int:
        """Number of pixels of all context views of all scenes."""
        return self.images[:, :, 0].numel()

    @cached_property
    def matching(self) -> Matching:
        """Disparity of the context views, with its consistency, from these views and the guides."""
        matching: Matching = self.codec.sender.extractor.match(self.images, self.cameras, self.guides, self.ignored)
        return matching

    @cached_property
    def overlap(self) -> ViewOverlap:
        """Overlap of the context views of one scene, with each other and with the guides, as matching shows it."""
        disparity = self.matching.depth.relative_disparity
        return view_overlap(self.images[0], disparity, self.cameras.scene(0), self.guides, self.ignored)

    def features(self, condition: RateCondition) -> Features:
        """Return F1 = E_mv(I, P). Only that of a conditioned adapter depends on the rate."""
        extractor = self.codec.sender.extractor
        return extractor.fuse(self.images, self.matching, condition) if extractor.is_conditioned else self._features

    @cached_property
    def _features(self) -> Features:
        features: Tensor = self.codec.sender.extractor.fuse(self.images, self.matching)
        return features

    @property
    def initial_state(self) -> Float[Tensor, "item channel 1 1"]:
        """S0. It is the same at every position, hence 1x1."""
        return self.codec.receiver.update.start(self.images.shape[0] * self.num_views, 1, 1)

    def analyse(self, features: Features, inputs: StageInputs) -> Latents:
        """y_k = g_a(concat(F_k, S_{k-1}))."""
        state = inputs.state.expand(-1, -1, *features.shape[-2:])
        y: Tensor = self.codec.sender.analysis(features, state, inputs.condition)
        return y

    def update(self, inputs: StageInputs, y_hat: Latents) -> Features:
        """S_k = U(concat(S_{k-1}, g_s(y_hat_k)))."""
        return self.codec.receiver.next_state(inputs.state, y_hat, inputs.condition)

    def predict(self, state: Features, condition: RateCondition) -> Prediction:
        """Return P(S_k) of all scenes."""
        return self.codec.receiver.predict(state, self.cameras, condition)

    def emit(
        self,
        prediction: Prediction,
        fading: Fading | None = None,
        *,
        has_fitted_colours: bool = True,
        is_filled: bool = True,
        scene: int = 0,
    ) -> Gaussians:
        """Return G_k of one scene: all Gaussians in their order, then the layer behind near surfaces.

        See `Emission` for what is left out. is_filled: False leaves out that layer, for rules that change opacities.
        """
        visibility = None if fading is None else fading.factors(prediction.attributes.opacity.numel())
        if self.cut_out is not None:
            is_covered = self.cut_out.is_covered.flatten().to(self.images.dtype)
            visibility = is_covered if visibility is None else is_covered * visibility
        emission = Emission(visibility, has_fitted_colours=has_fitted_colours, is_filled=is_filled and self.is_filled)
        return emit(prediction.scene(scene), self.cameras.scene(scene).as_batch(), self.codec.receiver.config, emission)

    @property
    def is_filled(self) -> bool:
        """Whether a decoder adds the layer behind near surfaces."""
        return is_filled_behind(self.num_views, self.cut_out is not None)

    def render(self, stage: Stage[Any]) -> StageRendering:
        """Render the context views as the receiver does after a stage. Requires a batch of one scene."""
        prediction = self.predict(stage.state, stage.inputs.condition)
        gaussians = self.emit(prediction, stage.fading)
        return StageRendering(prediction, (render(gaussians, self.cameras.scene(0), self.size, self.background),))

    @property
    def background(self) -> tuple[float, float, float]:
        """What is behind the Gaussians in `images`, sRGB: cut-outs are on white."""
        return BLACK if self.cut_out is None else WHITE

    def feedback(self, rendering: StageRendering, condition: RateCondition) -> Features:
        """F_{k+1} = E_fb(I, I_k_hat, depth errors). Gradients do not reach the previous stage."""
        rendered = torch.cat([scene.color[: self.num_views] for scene in rendering.scenes]).detach()
        disparity = rearrange(rendering.prediction.relative_disparity, "b v h w -> (b v) 1 h w")
        return self.features_of_errors(rendered, disparity, condition)

    def features_of_errors(
        self, rendered: Float[Tensor, "item 3 h w"], disparity: Float[Tensor, "item 1 h4 w4"], condition: RateCondition
    ) -> Features:
        """Apply E_fb. rendered: I_k_hat, sRGB in [0, 1]. disparity: relative disparity predicted after stage k."""
        images = rearrange(self.images, "b v rgb h w -> (b v) rgb h w")
        if self.ignored is not None:
            rendered = torch.where(self.ignored[:, None], images, rendered)
        errors = depth_feedback(self.matching.depth, disparity)
        features: Tensor = self.codec.sender.feedback(images, rendered, errors, condition)
        return features
