"""One training pass: both stages of the codec on a batch, and the loss of the paper's section 3.4 plus depth's."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.coding.rate import estimate_latents, uniform_noise
from fecocodec.container.lagrangian import LAMBDA_MIN, STEPS_PER_E
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.depth import relative_disparity_from_depth
from fecocodec.receiver.model import Receiver
from fecocodec.receiver.predictor import Prediction
from fecocodec.rendering.metrics import ssim
from fecocodec.rendering.rasterizer import Rendering, render
from fecocodec.sender.matched_depth import depth_feedback
from fecocodec.sender.model import Sender
from fecocodec.sender.steps import first_stage_lambda_q

SSIM_WEIGHT = 0.03
TARGET_WEIGHT = 2.0  # of a target view, against 1 for a context view
MATCHING_WEIGHT = 0.5
DISPARITY_WEIGHT = 0.5
AGREED = 0.7  # agreement of views from which matched depth of photographs is believed
# The entropy model serves every lambda alike, so it learns from bits at one price. At lambda's own it would learn from
# high lambdas alone, whose bits weigh a thousand times as much. This is the root mean square of lambda in training.
ENTROPY_PRICE = 2.7e-3


@dataclass(frozen=True)
class Batch:
    """Scenes with equally many views of one size: the first `num_context` views are coded, the others are targets.

    depth: exact depth of procedural scenes, NaN for photographs. cameras: normalised scenes.
    """

    images: Float[Tensor, "batch view 3 h w"]
    cameras: Cameras
    depth: Float[Tensor, "batch view h w"]
    num_context: int
    lambda_q: Int[Tensor, " batch"]

    def to(self, device: str) -> "Batch":
        """The same on a device."""
        images, depth, lambda_q = (tensor.to(device) for tensor in (self.images, self.depth, self.lambda_q))
        return Batch(images, self.cameras.to(device), depth, self.num_context, lambda_q)


@dataclass(frozen=True)
class MatchedDisparity:
    """What matching says of relative disparity at 1/4: learned, for the loss to judge, and settled, with agreement."""

    learned: Float[Tensor, "batch view h4 w4"]
    settled: Float[Tensor, "batch view h4 w4"]
    agreement: Float[Tensor, "batch view h4 w4"]


@dataclass(frozen=True)
class StageOutcome:
    """What one stage of a training pass produced. lambda_q: what it was coded at."""

    prediction: Prediction
    renderings: list[Rendering]  # one per scene, all its views
    estimated_bits: Float[Tensor, " batch"]
    lambda_q: Int[Tensor, " batch"]


Coding = Callable[[Tensor, Tensor, int, Tensor | None], tuple[Tensor, Tensor]]
"""(y, lambda_q, stage, y_hat of the stage before or None) -> y_hat, estimated bits per item."""


def code_with_noise(receiver: Receiver, sender: Sender) -> Coding:
    """The coding of the rate-distortion phases: rounding with straight-through gradients and an estimated rate.

    Gradients of the bits with respect to latents are lambda / ENTROPY_PRICE of what they are: see `loss_of`.
    """

    def code(y: Tensor, lambda_q: Tensor, stage: int, context: Tensor | None) -> tuple[Tensor, Tensor]:
        share = (lambda_of(lambda_q) / ENTROPY_PRICE)[:, None, None, None]
        priced = _scale_gradient(y, share)
        known = None if context is None else _scale_gradient(context, share)
        z = sender.hyper_analysis(priced)
        estimate = estimate_latents(receiver.prior, priced, z, lambda_q, stage, known, uniform_noise())
        y_hat = estimate.y_hat.detach() + (y - y.detach())
        return y_hat, estimate.bits_y + estimate.bits_z

    return code


def lambda_of(lambda_q: Int[Tensor, " item"]) -> Float[Tensor, " item"]:
    """The price of a bit a pixel from the container's fixed point."""
    return LAMBDA_MIN * torch.exp(lambda_q / STEPS_PER_E)


def stage_lambdas(lambda_q: Int[Tensor, " item"], num_stages: int) -> list[Int[Tensor, " item"]]:
    """What each stage is coded at, as the sender has it: the first more coarsely, if another follows."""
    if num_stages == 1:
        return [lambda_q]
    return [lambda_q + first_stage_lambda_q(0)] + [lambda_q] * (num_stages - 1)


def _scale_gradient(x: Tensor, factor: Tensor) -> Tensor:
    return x.detach() + factor * (x - x.detach())


def bypass_coding(y: Tensor, lambda_q: Tensor, stage: int, context: Tensor | None) -> tuple[Tensor, Tensor]:
    """The warm-up: latents get the noise of rounding, nothing is coded."""
    return y + torch.rand_like(y) - 0.5, y.new_zeros(y.shape[0])


def run_stages(
    sender: Sender, receiver: Receiver, batch: Batch, coding: Coding, num_stages: int
) -> tuple[list[StageOutcome], MatchedDisparity]:
    """Code, decode and render a batch; also returns what the extractor's matching found.

    A third stage and later ones, which streams cannot hold, work as the second does.
    """
    views = batch.num_context
    images, cameras = batch.images[:, :views], batch.cameras.select(list(range(views)))
    matching = sender.extractor.match(images, cameras)
    features = sender.extractor.fuse(images, matching)
    state = receiver.update.start(features.shape[0], *features.shape[-2:])
    outcomes: list[StageOutcome] = []
    context = None
    for stage, lambda_q_of_scene in enumerate(stage_lambdas(batch.lambda_q, num_stages), start=1):
        kind, lambda_q = min(stage, 2), lambda_q_of_scene.repeat_interleave(views)
        condition = receiver.condition(lambda_q, kind)
        if kind == 2:
            rendered = torch.stack([rendering.color[:views] for rendering in outcomes[-1].renderings]).detach()
            decoded = outcomes[-1].prediction.relative_disparity.flatten(0, 1)[:, None]
            errors = depth_feedback(matching.depth, decoded)
            features = sender.feedback(_flat(images), _flat(rendered), errors, condition)
        y = sender.analysis(features, state, condition)
        y_hat, bits = coding(y, lambda_q, kind, context)
        state, context = receiver.next_state(state, y_hat, condition), y_hat
        prediction = receiver.predict(state, cameras, condition)
        renderings = _render(batch, prediction, is_last=stage == num_stages)
        bits_of_scene = rearrange(bits, "(b v) -> b v", v=views).sum(dim=1)
        outcomes.append(StageOutcome(prediction, renderings, bits_of_scene, lambda_q_of_scene))
    found = (matching.relative_disparity, matching.depth.relative_disparity, matching.depth.agreement)
    matched = MatchedDisparity(*(rearrange(item, "(b v) 1 h w -> b v h w", v=views) for item in found))
    return outcomes, with_targets(sender, batch, matched)


@torch.no_grad()
def with_targets(sender: Sender, batch: Batch, matched: MatchedDisparity) -> MatchedDisparity:
    """The same; in photographs where the context views confirm nothing, what the target views confirm.

    Targets see much that only one context view sees, and whose depth is a guess to the sender.
    """
    if not batch.depth.isnan().any():
        return matched
    views = batch.num_context
    depth = sender.extractor.match(batch.images, batch.cameras).depth
    found = (depth.relative_disparity, depth.agreement)
    settled, agreed = (rearrange(item, "(b v) 1 h w -> b v h w", b=len(batch.images))[:, :views] for item in found)
    is_sure = matched.agreement > AGREED
    return MatchedDisparity(
        matched.learned, torch.where(is_sure, matched.settled, settled), torch.where(is_sure, matched.agreement, agreed)
    )


def _render(batch: Batch, prediction: Prediction, is_last: bool) -> list[Rendering]:
    """Stage 1 is judged on the context views, which feedback needs anyway, and one target; the last stage on all."""
    cameras = batch.cameras if is_last else batch.cameras.select(list(range(batch.num_context + 1)))
    size = (batch.images.shape[-2], batch.images.shape[-1])
    return [render(prediction.gaussians.scene(scene), cameras.scene(scene), size) for scene in range(len(batch.images))]


def loss_of(
    batch: Batch, outcomes: list[StageOutcome], matched: MatchedDisparity, disparity_weight: float
) -> tuple[Float[Tensor, ""], dict[str, float]]:
    """Sum over stages of lambda * R + L_render (paper, training strategy), each at its lambda, plus L1 on relative
    disparity.

    R is in bits per context pixel; disparity counts where depth is known, or views agree on it. The gradient of R is at
    ENTROPY_PRICE, which `code_with_noise` turns into lambda for all but the entropy model. Returns the loss and its
    parts for the log.
    """
    pixels = batch.num_context * batch.images.shape[-1] * batch.images.shape[-2]
    truth = _best_known_disparity(batch, matched)
    parts = {"matching": _masked_l1(matched.learned, truth)}
    total = disparity_weight * MATCHING_WEIGHT * parts["matching"]
    for stage, outcome in enumerate(outcomes, start=1):
        rendered = torch.stack([rendering.color for rendering in outcome.renderings])
        images = batch.images[:, : rendered.shape[1]]
        squared = (rendered - images).square().mean(dim=(0, 2, 3, 4))
        structure = 1.0 - ssim(rendered, images).mean(dim=0)
        weight = _view_weights(batch.num_context, images.shape[1]).to(squared)
        rate = outcome.estimated_bits / pixels
        disparity = _masked_l1(outcome.prediction.relative_disparity, truth)
        priced = ENTROPY_PRICE * (rate - rate.detach()) + lambda_of(outcome.lambda_q) * rate.detach()
        total = total + ((squared + SSIM_WEIGHT * structure) * weight).mean() + priced.mean()
        total = total + disparity_weight * DISPARITY_WEIGHT * disparity
        parts |= {
            f"mse{stage}": squared[batch.num_context :].mean(),
            f"mse_context{stage}": squared[: batch.num_context].mean(),
            f"bpp{stage}": rate.mean(),
            f"disparity{stage}": disparity,
        }
    return total, {name: float(value.detach()) for name, value in parts.items()}


def _view_weights(num_context: int, num_views: int) -> Float[Tensor, " view"]:
    """Targets count more than context views, which are easy to fit without getting depth right; the mean is 1."""
    weights = torch.ones(num_views)
    weights[num_context:] = TARGET_WEIGHT
    return weights / weights.mean()


def _best_known_disparity(batch: Batch, matched: MatchedDisparity) -> Float[Tensor, "batch view h4 w4"]:
    """The exact one; in photographs the matched one where views agree, NaN elsewhere.

    Matched depth has sharper edges than what latents and state make of it, and none of its errors is shared by both
    views. On dev pairs, moving decoded depth halfway to it gained 0.17 dB without any training.
    """
    is_photograph = batch.depth.isnan().all(dim=(1, 2, 3), keepdim=True)
    agreed = torch.where(matched.agreement > AGREED, matched.settled, torch.nan)
    return torch.where(is_photograph, agreed, _true_disparity(batch))


def _true_disparity(batch: Batch) -> Float[Tensor, "batch view h4 w4"]:
    views = batch.num_context
    relative = relative_disparity_from_depth(batch.depth[:, :views], batch.cameras)
    pooled = F.avg_pool2d(relative.flatten(0, 1)[:, None], 4)[:, 0]
    return rearrange(pooled, "(b v) h w -> b v h w", v=views)


def _masked_l1(found: Tensor, truth: Tensor) -> Float[Tensor, ""]:
    known = torch.isfinite(truth)
    difference = (found - torch.where(known, truth.clamp(-0.05, 1.05), found.detach())).abs()
    return difference.mean()


def _flat(x: Float[Tensor, "batch view channel h w"]) -> Float[Tensor, "item channel h w"]:
    return rearrange(x, "b v c h w -> (b v) c h w")
