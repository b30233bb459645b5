"""Refinement of the second stage: its latents follow the gradient of what they are for, before they are coded.

Networks guess in one pass what is missing; the sender can render what its guess gives, so it can come closer to the
photographs. Published for images (Campos et al., "Content Adaptive Optimization for Neural Image Compression", 2019);
here the gradient comes through the receiver's networks and the rasteriser. Receivers see nothing of it. Views between
the photographs gain much less, and in some scenes lose, and it takes several times as long as encoding without
(docs/experiments.md), so it is left out unless asked for.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.coding.rate import estimate_latents, straight_through
from fecocodec.container.lagrangian import dequantise_lambda
from fecocodec.receiver.view_states import ViewStates, update_views
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.distortion import distortions
from fecocodec.sender.steps import CodedStage, Latents, PreparedScene, Profile

STEP_SIZE = 0.15  # root mean square of the first step, in quantisation steps
MOMENTUM = 0.7
MOST_PIXELS = 2**20  # padded, of all views: beyond it the gradient's memory would be several GiB


def can_refine(scene: PreparedScene) -> bool:
    """Whether the scene is small enough for gradients."""
    return scene.num_views * scene.images.shape[-2] * scene.images.shape[-1] <= MOST_PIXELS


def refine_second_stage(
    profile: Profile, scene: PreparedScene, latents: Latents, first: CodedStage, lambda_q: int, num_steps: int
) -> Latents:
    """Latents of all views after `num_steps` of gradient descent on D + lambda R, with rounding straight through.

    D is measured on the context views as rendered after stage 2, R estimated by the prior. A step has the same length
    whatever the gradient's; one that raises the objective is taken back, and the next are half as long. Scenes that are
    too large for the gradient's memory (`can_refine`) are left as they are.
    """
    if num_steps == 0 or not can_refine(scene):
        return latents
    best_y = latents.y.detach()
    best, best_gradient = _objective(profile, scene, Latents(best_y, latents.z), first, lambda_q)
    momentum, step_size = best_gradient, STEP_SIZE
    for _ in range(num_steps):
        length = momentum.square().mean().sqrt()
        if not bool(torch.isfinite(length)) or float(length) == 0.0:
            break
        y = best_y - step_size * momentum / length
        found, gradient = _objective(profile, scene, Latents(y, latents.z), first, lambda_q)
        if found < best:
            best, best_y, best_gradient = found, y, gradient
            momentum = MOMENTUM * momentum + gradient
        else:
            momentum, step_size = best_gradient, step_size / 2
    return Latents(best_y, profile.sender.hyper_analysis(best_y))


@torch.enable_grad()
def _objective(
    profile: Profile, scene: PreparedScene, latents: Latents, first: CodedStage, lambda_q: int
) -> tuple[float, Float[Tensor, "view latent h8 w8"]]:
    """D + lambda R, and its gradient with respect to y."""
    receiver, num_views = profile.receiver, scene.num_views
    lambdas = scene.lambda_of_views(lambda_q)
    y = latents.y.detach().requires_grad_()
    estimate = estimate_latents(receiver.prior, y, latents.z, lambdas, 2, first.latents.y_hat, straight_through)
    states = update_views(receiver, first.after, estimate.y_hat, lambdas, 2, tuple(range(num_views)))
    rate = estimate.bits_y.sum() / (num_views * scene.images.shape[-2] * scene.images.shape[-1])
    loss = distortions(_rendering(profile, scene, states), scene.images).mean() + dequantise_lambda(lambda_q) * rate
    return float(loss.detach()), torch.autograd.grad(loss, y)[0]


def _rendering(profile: Profile, scene: PreparedScene, states: ViewStates) -> Float[Tensor, "view 3 h w"]:
    prediction = profile.receiver.predict(states.state, scene.cameras.as_batch(), states.condition)
    return render(prediction.gaussians.scene(0), scene.cameras, (scene.images.shape[-2], scene.images.shape[-1])).color
