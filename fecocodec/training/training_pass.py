"""One training pass: the stages of the codec on a batch, with latents coded by an estimate of the rate."""

from functools import cached_property
from typing import Any

import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.coding.rate import additive_noise, estimate_latents, rounding, uniform_noise
from fecocodec.receiver.model import Receiver
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.ablations import without
from fecocodec.sender.codec import Codec
from fecocodec.sender.distortion import Distortion
from fecocodec.sender.lambda_roles import stage_lambdas
from fecocodec.sender.model import Sender
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.stages import (
    NO_IMPROVEMENTS,
    EstimatedLatent,
    Improvements,
    LatentCoder,
    Stage,
    StageInputs,
    StageRendering,
)
from fecocodec.training.batch import Batch, Extracted, MatchedDisparity, StageOutcome
from fecocodec.training.loss import ENTROPY_PRICE, MIN_CONSISTENCY, errors_and_rate, lambda_of
from fecocodec.training.step_learning import StepLearner

Coding = LatentCoder[EstimatedLatent]


def code_with_noise(receiver: Receiver, sender: Sender) -> Coding:
    """Return the latent coder of the rate-distortion phases: straight-through rounding and an estimated rate.

    Gradients of the bits with respect to the latents are scaled by lambda / ENTROPY_PRICE; see `loss_of`.
    """

    def code(y: Tensor, inputs: StageInputs) -> EstimatedLatent:
        share = (lambda_of(inputs.lambda_q) / ENTROPY_PRICE)[:, None, None, None]
        priced = _scale_gradient(y, share)
        context = None if inputs.y_hat is None else _scale_gradient(inputs.y_hat, share)
        z = sender.hyper_analysis(priced)
        surrogate = rounding(uniform_noise())
        estimate = estimate_latents(receiver.prior, priced, z, inputs.lambda_q, inputs.stage, context, surrogate)
        return EstimatedLatent(estimate.y_hat.detach() + (y - y.detach()), estimate.bits_y + estimate.bits_z)

    return code


def code_with_additive_noise(receiver: Receiver, sender: Sender) -> Coding:
    """Return the paper's latent coder: uniform noise replaces rounding, for g_s and for the rate."""

    def code(y: Tensor, inputs: StageInputs) -> EstimatedLatent:
        z = sender.hyper_analysis(y)
        estimate = estimate_latents(
            receiver.prior, y, z, inputs.lambda_q, inputs.stage, inputs.y_hat, additive_noise(uniform_noise())
        )
        return EstimatedLatent(estimate.y_hat, estimate.bits_y + estimate.bits_z)

    return code


def bypass_coding(y: Tensor, inputs: StageInputs) -> EstimatedLatent:
    """Code latents during warm-up: add uniform noise in [-1/2, 1/2), with zero bits."""
    return EstimatedLatent(y + torch.rand_like(y) - 0.5, y.new_zeros(y.shape[0]))


def _scale_gradient(x: Tensor, factor: Tensor) -> Tensor:
    return x.detach() + factor * (x - x.detach())


class BatchEncoder(SceneEncoder):
    """Scene encoder for a training batch. It also renders target views; colours do not depend on the direction."""

    def __init__(
        self,
        sender: Sender,
        receiver: Receiver,
        batch: Batch,
        extracted: Extracted | None = None,
        has_all_targets: bool = False,
    ) -> None:
        """extracted: what frozen parts of the extractor compute, None to compute it here.

        has_all_targets: whether every stage is rendered at all target views, and not only the last one.
        """
        context = list(range(batch.num_context))
        super().__init__(Codec(sender, receiver, b""), batch.images[:, context], batch.cameras.select(context))
        self.batch, self.extracted, self.has_all_targets = batch, extracted, has_all_targets

    @cached_property
    def matching(self) -> Any:
        return super().matching if self.extracted is None else self.extracted.matching

    @cached_property
    def _features(self) -> Float[Tensor, "item channel h4 w4"]:
        if self.extracted is None or self.extracted.features is None:
            return super()._features
        return self.extracted.features

    @property
    def matched(self) -> MatchedDisparity:
        """Disparity of matching, for the loss."""
        if self.extracted is not None:
            return self.extracted.matched
        return with_targets(self.codec.sender, self.batch, self.matched_in_context)

    @property
    def matched_in_context(self) -> MatchedDisparity:
        """Disparity of matching among the context views alone."""
        if self.extracted is not None:
            return self.extracted.matched
        maps = (
            self.matching.relative_disparity,
            self.matching.depth.relative_disparity,
            self.matching.depth.consistency,
        )
        return MatchedDisparity(*(rearrange(item, "(b v) 1 h w -> b v h w", v=self.num_views) for item in maps))

    def render(self, stage: Stage[Any]) -> StageRendering:
        """Render the context views, which feedback needs, and one target view or all of them."""
        return self.render_views(stage, self.batch.images.shape[1] if self.has_all_targets else self.num_views + 1)

    def render_views(self, stage: Stage[Any], num_views: int) -> StageRendering:
        """Render the first `num_views` views of every scene."""
        prediction = self.predict(stage.state, stage.inputs.condition)
        cameras = self.batch.cameras.select(list(range(num_views)))
        scenes = (
            render(self.emit(prediction, has_fitted_colours=False, scene=scene), cameras.scene(scene), self.size)
            for scene in range(len(self.images))
        )
        return StageRendering(prediction, tuple(scenes))


@torch.no_grad()
def extract(sender: Sender, receiver: Receiver, is_fused: bool, batch: Batch) -> Extracted:
    """Compute what the frozen parts of an extractor give for a batch. is_fused: whether its fusion is frozen too."""
    encoder = BatchEncoder(sender, receiver, batch)
    return Extracted(encoder.matching, encoder._features if is_fused else None, encoder.matched)


def run_stages(
    sender: Sender,
    receiver: Receiver,
    batch: Batch,
    coding: Coding,
    num_stages: int,
    extracted: Extracted | None = None,
    disparity_weight: float = 1.0,
    learner: StepLearner | None = None,
    has_all_targets: bool = False,
) -> tuple[list[StageOutcome], MatchedDisparity]:
    """Code, decode and render a batch; returns the results per stage and the disparity of matching.

    learner: optimises the latents before they are coded, None for latents as g_a gives them.
    disparity_weight: with 0, target views are not matched, which would take a third of a step. The last stage is
    rendered at all views. extracted, has_all_targets: see `BatchEncoder`.
    """
    encoder = without(sender.config.ablation, BatchEncoder)(sender, receiver, batch, extracted, has_all_targets)
    improve = NO_IMPROVEMENTS if learner is None else Improvements(learner.optimiser(encoder, batch))
    stages = encoder.run(batch.lambda_q, num_stages, coding, improve)
    renderings = [stage.feedback for stage in stages[1:] if stage.feedback is not None]
    renderings.append(encoder.render_views(stages[-1], batch.images.shape[1]))
    lambdas = stage_lambdas(batch.lambda_q, num_stages, receiver.config.kind.stage_1_offset)
    outcomes = [
        StageOutcome(
            rendering.prediction,
            rendering.scenes,
            rearrange(stage.coded.bits, "(b v) -> b v", v=encoder.num_views).sum(dim=1),
            lambda_q,
        )
        for stage, rendering, lambda_q in zip(stages, renderings, lambdas, strict=True)
    ]
    return outcomes, encoder.matched if disparity_weight else encoder.matched_in_context


@torch.no_grad()
def with_targets(sender: Sender, batch: Batch, matched: MatchedDisparity) -> MatchedDisparity:
    """Replace inconsistent disparity of photographs by that of matching with the target views included.

    Surfaces visible in only one context view, where the sender cannot measure depth, are often visible in target views.
    """
    if not batch.depth.isnan().any():
        return matched
    views = batch.num_context
    depth = sender.extractor.match(batch.images, batch.cameras).depth
    maps = (depth.relative_disparity, depth.consistency)
    disparity, consistency = (rearrange(x, "(b v) 1 h w -> b v h w", b=len(batch.images))[:, :views] for x in maps)
    is_consistent = matched.consistency > MIN_CONSISTENCY
    return MatchedDisparity(
        matched.learned,
        torch.where(is_consistent, matched.aggregated, disparity),
        torch.where(is_consistent, matched.consistency, consistency),
    )


def paper_loss(
    batch: Batch, outcomes: list[StageOutcome], distortion: Distortion
) -> tuple[Float[Tensor, ""], dict[str, float]]:
    """Return the loss and its parts for the log (paper, training strategy).

    The loss is the sum over stages of lambda R_k plus the sum of D over all target views; mean over the batch.
    """
    num_context, total = batch.num_context, batch.images.new_zeros(())
    parts: dict[str, Tensor] = {}
    for stage, outcome in enumerate(outcomes, start=1):
        images, rate = outcome.images, outcome.estimated_bits / batch.num_context_pixels
        rendering_loss = distortion(images[:, num_context:], batch.images[:, num_context:]).sum(dim=1)
        total = total + (lambda_of(batch.lambda_q) * rate + rendering_loss).mean()
        parts |= errors_and_rate(batch, stage, images, rate)
    return total, {name: float(value.detach()) for name, value in parts.items()}
