"""One training pass: the stages of the codec on a batch, and the loss of the paper (section 3.4) plus a depth loss."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.coding.rate import estimate_latents, rounding, uniform_noise
from fecocodec.container.lambda_quantisation import LAMBDA_MIN, STEPS_PER_E
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.depth import relative_disparity_from_depth
from fecocodec.receiver.model import Receiver
from fecocodec.receiver.predictor import Prediction
from fecocodec.rendering.rasterizer import Rendering, render
from fecocodec.sender.codec import Codec
from fecocodec.sender.distortion import Distortion, MseDistortion
from fecocodec.sender.latent_coding import EstimatedLatent
from fecocodec.sender.model import Sender
from fecocodec.sender.scene_encoder import LatentCoder, SceneEncoder, Stage, StageInputs, StageRendering
from fecocodec.sender.stage_lambdas import stage_1_offset, stage_lambdas

MATCHING_WEIGHT = 0.5
DISPARITY_WEIGHT = 0.5
MIN_CONSISTENCY = 0.7  # cross-view consistency above which matched depth of photographs supervises disparity
# Weight of the rate in the gradient of the entropy model, the same for every lambda. Weighted by lambda, bits at high
# lambda would count a thousand times as much as those at low lambda. The value is the root mean square of lambda in
# training.
ENTROPY_PRICE = 2.7e-3


@dataclass(frozen=True)
class Batch:
    """Scenes with equally many views of one size. The first `num_context` views are coded, the others are targets.

    images: sRGB in [0, 1]. cameras: in the normalised frame of each scene. depth: in units of near, exact for
    procedural scenes, NaN for photographs. skipped: one sentence for each scene that was drawn and could not be used.
    """

    images: Float[Tensor, "batch view 3 h w"]
    cameras: Cameras
    depth: Float[Tensor, "batch view h w"]
    num_context: int
    lambda_q: Int[Tensor, " batch"]
    skipped: tuple[str, ...] = ()

    def to(self, device: str) -> "Batch":
        """Return the batch on a device."""
        images, depth, lambda_q = (
            tensor.to(device, non_blocking=True) for tensor in (self.images, self.depth, self.lambda_q)
        )
        return replace(self, images=images, cameras=self.cameras.to(device), depth=depth, lambda_q=lambda_q)


@dataclass(frozen=True)
class MatchedDisparity:
    """Relative disparity at 1/4: trainable, aggregated by matching, and the cross-view consistency of the latter."""

    learned: Float[Tensor, "batch view h4 w4"]
    aggregated: Float[Tensor, "batch view h4 w4"]
    consistency: Float[Tensor, "batch view h4 w4"]


@dataclass(frozen=True)
class Extracted:
    """What the extractor computes for a batch; constant while the extractor is frozen.

    matching: its result at the context views. features: F1. matched: disparity for the loss.
    """

    matching: Any
    features: Float[Tensor, "item channel h4 w4"]
    matched: MatchedDisparity

    def half(self) -> "Extracted":
        """The same with features in half precision."""
        return replace(self, features=self.features.half())

    def float(self) -> "Extracted":
        """The same with features in single precision."""
        return replace(self, features=self.features.float())


@dataclass(frozen=True)
class StageOutcome:
    """Results of one stage of a training pass. lambda_q: quantised lambda of the stage."""

    prediction: Prediction
    renderings: tuple[Rendering, ...]  # one per scene, all its views
    estimated_bits: Float[Tensor, " batch"]
    lambda_q: Int[Tensor, " batch"]


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


def bypass_coding(y: Tensor, inputs: StageInputs) -> EstimatedLatent:
    """Code latents during warm-up: add uniform noise in [-1/2, 1/2), with zero bits."""
    return EstimatedLatent(y + torch.rand_like(y) - 0.5, y.new_zeros(y.shape[0]))


def lambda_of(lambda_q: Int[Tensor, " item"]) -> Float[Tensor, " item"]:
    """Return lambda of quantised lambda."""
    return LAMBDA_MIN * torch.exp(lambda_q / STEPS_PER_E)


def _scale_gradient(x: Tensor, factor: Tensor) -> Tensor:
    return x.detach() + factor * (x - x.detach())


class BatchEncoder(SceneEncoder):
    """Scene encoder for a training batch. It also renders target views; colours do not depend on the direction."""

    def __init__(self, sender: Sender, receiver: Receiver, batch: Batch, extracted: Extracted | None = None) -> None:
        """extracted: what the extractor computes, None to compute it here."""
        context = list(range(batch.num_context))
        super().__init__(Codec(sender, receiver, b""), batch.images[:, context], batch.cameras.select(context))
        self.batch, self.extracted = batch, extracted

    @cached_property
    def matching(self) -> Any:
        return super().matching if self.extracted is None else self.extracted.matching

    @cached_property
    def features(self) -> Float[Tensor, "item channel h4 w4"]:
        return super().features if self.extracted is None else self.extracted.features

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
        """Render the context views, which feedback needs, and one target view."""
        return self.render_views(stage, self.num_views + 1)

    def render_views(self, stage: Stage[Any], num_views: int) -> StageRendering:
        """Render the first `num_views` views of every scene."""
        prediction = self.predict(stage.state, stage.inputs.condition)
        cameras = self.batch.cameras.select(list(range(num_views)))
        scenes = (
            render(prediction.gaussians.scene(scene), cameras.scene(scene), self.size)
            for scene in range(len(self.images))
        )
        return StageRendering(prediction, tuple(scenes))


@torch.no_grad()
def extract(sender: Sender, receiver: Receiver, batch: Batch) -> Extracted:
    """Compute what a frozen extractor gives for a batch."""
    encoder = BatchEncoder(sender, receiver, batch)
    return Extracted(encoder.matching, encoder.features, encoder.matched)


def run_stages(
    sender: Sender,
    receiver: Receiver,
    batch: Batch,
    coding: Coding,
    num_stages: int,
    extracted: Extracted | None = None,
    disparity_weight: float = 1.0,
) -> tuple[list[StageOutcome], MatchedDisparity]:
    """Code, decode and render a batch; returns the results per stage and the disparity of matching.

    disparity_weight: with 0, target views are not matched, which would take a third of a step. The last stage is
    rendered at all views, earlier stages at the context views and one target view.
    """
    encoder = BatchEncoder(sender, receiver, batch, extracted)
    stages = encoder.run(batch.lambda_q, num_stages, coding)
    renderings = [stage.feedback for stage in stages[1:] if stage.feedback is not None]
    renderings.append(encoder.render_views(stages[-1], batch.images.shape[1]))
    outcomes = [
        StageOutcome(
            rendering.prediction,
            rendering.scenes,
            rearrange(stage.coded.bits, "(b v) -> b v", v=encoder.num_views).sum(dim=1),
            lambda_q,
        )
        for stage, rendering, lambda_q in zip(
            stages, renderings, stage_lambdas(batch.lambda_q, num_stages, stage_1_offset(receiver.config)), strict=True
        )
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


def loss_of(
    batch: Batch,
    outcomes: list[StageOutcome],
    matched: MatchedDisparity,
    disparity_weight: float,
    distortion: Distortion = MseDistortion(),  # noqa: B008 - frozen
    background: Float[Tensor, "batch 3"] | None = None,
) -> tuple[Float[Tensor, ""], dict[str, float]]:
    """Return the loss and its parts for the log.

    The loss is the sum over stages of D + lambda R (paper, training strategy), with lambda of the stage, plus L1 losses
    on relative disparity. D: weighted mean of `distortion` over views, rendered over `background`, an sRGB colour per
    scene, black by default. R: bits per context pixel. Disparity is supervised where depth is known or cross-view
    consistent. The gradient of R has the weight ENTROPY_PRICE, which `code_with_noise` rescales to lambda for all
    networks except the entropy model.
    """
    pixels = batch.num_context * batch.images.shape[-1] * batch.images.shape[-2]
    truth = _best_known_disparity(batch, matched)
    parts = {"matching": _masked_l1(matched.learned, truth)}
    total = disparity_weight * MATCHING_WEIGHT * parts["matching"]
    for stage, outcome in enumerate(outcomes, start=1):
        rendered = _over_background(outcome.renderings, background)
        images = batch.images[:, : rendered.shape[1]]
        squared = (rendered.detach() - images).square().mean(dim=(0, 2, 3, 4))
        weight = _view_weights(batch.num_context, images.shape[1], distortion.target_weight).to(squared)
        rate = outcome.estimated_bits / pixels
        disparity = _masked_l1(outcome.prediction.relative_disparity, truth)
        priced = ENTROPY_PRICE * (rate - rate.detach()) + lambda_of(outcome.lambda_q) * rate.detach()
        total = total + (distortion(rendered, images).mean(dim=0) * weight).mean() + priced.mean()
        total = total + disparity_weight * DISPARITY_WEIGHT * disparity
        parts |= {
            f"mse{stage}": squared[batch.num_context :].mean(),
            f"mse_context{stage}": squared[: batch.num_context].mean(),
            f"bpp{stage}": rate.mean(),
            f"disparity{stage}": disparity,
        }
    return total, {name: float(value.detach()) for name, value in parts.items()}


def _over_background(
    renderings: tuple[Rendering, ...], background: Float[Tensor, "batch 3"] | None
) -> Float[Tensor, "batch view 3 h w"]:
    """Return the images over a background colour. renderings: over black."""
    colour = torch.stack([rendering.color for rendering in renderings])
    if background is None:
        return colour
    transparency = 1.0 - torch.stack([rendering.alpha for rendering in renderings])
    return colour + transparency[:, :, None] * background[:, None, :, None, None]


def _view_weights(num_context: int, num_views: int, target_weight: float) -> Float[Tensor, " view"]:
    """Return the weight of each view, 1 on average.

    Target views have a larger weight, because context views can be fitted with wrong depth.
    """
    weights = torch.ones(num_views)
    weights[num_context:] = target_weight
    return weights / weights.mean()


def _best_known_disparity(batch: Batch, matched: MatchedDisparity) -> Float[Tensor, "batch view h4 w4"]:
    """Return exact disparity for procedural scenes, consistent matched disparity for photographs, NaN elsewhere.

    Matched depth has sharper edges than decoded depth, and its errors differ between the views.
    """
    is_photograph = batch.depth.isnan().all(dim=(1, 2, 3), keepdim=True)
    consistent = torch.where(matched.consistency > MIN_CONSISTENCY, matched.aggregated, torch.nan)
    return torch.where(is_photograph, consistent, _true_disparity(batch))


def _true_disparity(batch: Batch) -> Float[Tensor, "batch view h4 w4"]:
    views = batch.num_context
    relative = relative_disparity_from_depth(batch.depth[:, :views], batch.cameras)
    pooled = F.avg_pool2d(relative.flatten(0, 1)[:, None], 4)[:, 0]
    return rearrange(pooled, "(b v) h w -> b v h w", v=views)


def _masked_l1(predicted: Tensor, truth: Tensor) -> Float[Tensor, ""]:
    """Return the L1 error, where `truth` is finite, as a mean over all pixels."""
    known = torch.isfinite(truth)
    difference = (predicted - torch.where(known, truth.clamp(-0.05, 1.05), predicted.detach())).abs()
    return difference.mean()
