"""The loss of training: distortion and rate of each stage (paper, section 3.4), plus a loss on depth."""

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.container.lambda_quantisation import LAMBDA_MIN, STEPS_PER_E
from fecocodec.geometry.cameras import relative_disparity_from_depth
from fecocodec.grid import FEATURES
from fecocodec.rendering.perceptual import st_lpips
from fecocodec.sender.distortion import Distortion, MseDistortion
from fecocodec.training.batch import Batch, MatchedDisparity, StageOutcome

MATCHING_WEIGHT = 0.5
DISPARITY_WEIGHT = 0.5
MIN_CONSISTENCY = 0.7  # cross-view consistency above which matched depth of photographs supervises disparity
# Weight of the rate in the gradient of the entropy model, the same for every lambda. Weighted by lambda, bits at high
# lambda would count a thousand times as much as those at low lambda. The value is the root mean square of lambda in
# training.
ENTROPY_PRICE = 2.7e-3


def lambda_of(lambda_q: Int[Tensor, " item"]) -> Float[Tensor, " item"]:
    """Return lambda of quantised lambda."""
    return LAMBDA_MIN * torch.exp(lambda_q / STEPS_PER_E)


def loss_of(
    batch: Batch,
    outcomes: list[StageOutcome],
    matched: MatchedDisparity,
    disparity_weight: float,
    distortion: Distortion = MseDistortion(),  # noqa: B008 - frozen
    perceptual_weight: float = 0.0,
) -> tuple[Float[Tensor, ""], dict[str, float]]:
    """Return the loss and its parts for the log.

    The loss is the sum over stages of D + lambda R (paper, training strategy), with lambda of the stage, plus L1 losses
    on relative disparity. D: weighted mean of `distortion` over views. D of the last stage also has `perceptual_weight`
    times ST-LPIPS. R: bits per context pixel. Disparity is supervised where depth is known or cross-view consistent.
    The gradient of R has the weight ENTROPY_PRICE, which `code_with_noise` rescales to lambda for all networks except
    the entropy model.
    """
    truth = _best_known_disparity(batch, matched)
    parts = {"matching": _masked_l1(matched.learned, truth)}
    total = disparity_weight * MATCHING_WEIGHT * parts["matching"]
    for stage, outcome in enumerate(outcomes, start=1):
        rendered, rate = outcome.images, outcome.estimated_bits / batch.num_context_pixels
        images = batch.images[:, : rendered.shape[1]]
        weight = _view_weights(batch.num_context, images.shape[1], distortion.target_weight).to(images)
        disparity = _masked_l1(outcome.prediction.relative_disparity, truth)
        priced = ENTROPY_PRICE * (rate - rate.detach()) + lambda_of(outcome.lambda_q) * rate.detach()
        total = total + (distortion(rendered, images).mean(dim=0) * weight).mean() + priced.mean()
        total = total + disparity_weight * DISPARITY_WEIGHT * disparity
        if perceptual_weight and stage == len(outcomes):
            parts["perceptual"] = perceptual_distance(rendered, images, batch.num_context, weight)
            total = total + perceptual_weight * parts["perceptual"]
        parts |= errors_and_rate(batch, stage, rendered, rate) | {f"disparity{stage}": disparity}
    return total, {name: float(value.detach()) for name, value in parts.items()}


def errors_and_rate(
    batch: Batch, stage: int, rendered: Float[Tensor, "batch view 3 h w"], rate: Float[Tensor, " batch"]
) -> dict[str, Tensor]:
    """Return what the log says of a stage: squared errors of target and context views, and bits per context pixel."""
    squared = (rendered.detach() - batch.images[:, : rendered.shape[1]]).square().mean(dim=(0, 2, 3, 4))
    return {
        f"mse{stage}": squared[batch.num_context :].mean(),
        f"mse_context{stage}": squared[: batch.num_context].mean(),
        f"bpp{stage}": rate.mean(),
    }


def perceptual_distance(
    rendered: Float[Tensor, "batch view 3 h w"],
    images: Float[Tensor, "batch view 3 h w"],
    num_context: int,
    weights: Float[Tensor, " view"],
) -> Float[Tensor, ""]:
    """Estimate the weighted mean of ST-LPIPS over all views from one context and one target view, drawn at random.

    ST-LPIPS of all views would take about as long as the rest of a training step.
    """
    num_views = images.shape[1]
    chosen = [int(torch.randint(num_context, ())), int(torch.randint(num_context, num_views, ()))]
    shares = weights.new_tensor([num_context, num_views - num_context]) / num_views
    return (shares * weights[chosen] * st_lpips(rendered[:, chosen], images[:, chosen]).mean(dim=0)).sum()


def _view_weights(num_context: int, num_views: int, target_weight: float) -> Float[Tensor, " view"]:
    """Return weights, 1 on average. Context views can be fitted with wrong depth, so target views weigh more."""
    weights = torch.ones(num_views)
    weights[num_context:] = target_weight
    return weights / weights.mean()


def _best_known_disparity(batch: Batch, matched: MatchedDisparity) -> Float[Tensor, "batch view h4 w4"]:
    """Return exact disparity for synthetic scenes, consistent matched disparity for photographs, NaN elsewhere.

    Matched depth has sharper edges than decoded depth, and its errors differ between the views.
    """
    is_photograph = batch.depth.isnan().all(dim=(1, 2, 3), keepdim=True)
    consistent = torch.where(matched.consistency > MIN_CONSISTENCY, matched.aggregated, torch.nan)
    return torch.where(is_photograph, consistent, _true_disparity(batch))


def _true_disparity(batch: Batch) -> Float[Tensor, "batch view h4 w4"]:
    views = batch.num_context
    relative = relative_disparity_from_depth(batch.depth[:, :views], batch.cameras)
    pooled = F.avg_pool2d(relative.flatten(0, 1)[:, None], FEATURES)[:, 0]
    return rearrange(pooled, "(b v) h w -> b v h w", v=views)


def _masked_l1(predicted: Tensor, truth: Tensor) -> Float[Tensor, ""]:
    """Return the L1 error, where `truth` is finite, as a mean over all pixels."""
    known = torch.isfinite(truth)
    difference = (predicted - torch.where(known, truth.clamp(-0.05, 1.05), predicted.detach())).abs()
    return difference.mean()
