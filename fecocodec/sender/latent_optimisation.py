"""Optimise the latents for D + price * R before coding, by gradient descent through the receiver and the rasteriser.

Follows Campos et al., "Content Adaptive Optimization for Neural Image Compression", 2019, who optimise latents of
images. The stream format and the receiver do not change. Results: docs/experiments.md.
"""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.nearby_cameras import cameras_between
from fecocodec.layers.blocks import RateCondition, direct_gradients
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.latent_coding import EstimatedLatent
from fecocodec.sender.optimisation_config import OptimisationConfig, price_of_rate, step_size, steps_of_first
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.stages import LatentCoder, OnFraction, Optimise, StageInputs

Objective = Callable[[Float[Tensor, "view latent h8 w8"]], Float[Tensor, ""]]


@dataclass(frozen=True)
class HeldViews:
    """Views between the context views, rendered before the optimisation, which penalises changes of them."""

    cameras: Cameras
    images: Float[Tensor, "view 3 h w"]


def optimiser(
    encoder: SceneEncoder, config: OptimisationConfig, estimate: LatentCoder[EstimatedLatent], lambda_q: int
) -> Optimise:
    """Return the `optimise` argument of `SceneEncoder.run` for one scene whose last stage is coded at `lambda_q`.

    estimate: differentiable coder, (y, inputs) -> y_hat and bits.
    """
    num_steps = config.steps_of_last(encoder.num_pixels, lambda_q)

    def optimise(y: Tensor, inputs: StageInputs, on_fraction: OnFraction) -> Tensor:
        steps = num_steps if inputs.is_last else steps_of_first(num_steps)
        return optimise_latents(encoder, config, estimate, inputs, y, steps, on_fraction)

    return optimise


def optimise_latents(
    encoder: SceneEncoder,
    config: OptimisationConfig,
    estimate: LatentCoder[EstimatedLatent],
    inputs: StageInputs,
    y: Float[Tensor, "view latent h8 w8"],
    num_steps: int,
    on_fraction: OnFraction = lambda _fraction: None,
) -> Float[Tensor, "view latent h8 w8"]:
    """Return y of one stage after `num_steps` steps of gradient descent on D + price * R.

    D is the distortion of the context views, rendered after this stage. R is the rate that `estimate` returns.
    on_fraction: called before each step.
    """
    if num_steps == 0:
        return y
    lambda_q = int(inputs.lambda_q[0])
    price = price_of_rate(config, lambda_q) / encoder.num_pixels

    def gaussians_of(y_hat: Tensor) -> Gaussians:
        gaussians = _gaussians(encoder, config, encoder.update(inputs, y_hat), inputs.condition)
        return gaussians if inputs.fading is None else inputs.fading.faded(gaussians)

    held = None
    if num_steps > config.max_steps_unheld:
        held = hold_views_between(encoder, gaussians_of(estimate(y, inputs).y_hat))

    num_evaluated = 0

    def objective(y: Tensor) -> Tensor:
        nonlocal num_evaluated
        on_fraction(num_evaluated / num_steps)
        num_evaluated += 1
        estimated = estimate(y, inputs)
        distortion = _distortion(encoder, config, gaussians_of(estimated.y_hat), held)
        return distortion + price * estimated.bits.sum()

    return descend(y, objective, num_steps, step_size(config, inputs.condition))


def descend(
    start: Float[Tensor, "view latent h8 w8"], objective: Objective, num_steps: int, first_length: float
) -> Float[Tensor, "view latent h8 w8"]:
    """Run normalised gradient descent from `start`. The RMS length of the steps decreases linearly to zero.

    first_length: RMS of the first step, in units of y. A step that increases the objective is undone, and the following
    steps are halved. The last step is not checked, because a check takes half as long as a step.
    """
    y = best_y = start.detach()
    best, direction, longest = float("inf"), torch.zeros_like(y), first_length
    for number in range(num_steps):
        value, gradient = _value_and_gradient(objective, y)
        length = gradient.square().mean().sqrt()
        is_usable = bool(torch.isfinite(length)) and float(length) > 0.0
        if value < best and is_usable:
            best, best_y, direction = value, y, gradient / length
        else:
            longest /= 2
        y = best_y - longest * (1.0 - number / (num_steps + 1)) * direction
    return y


@torch.no_grad()
def hold_views_between(encoder: SceneEncoder, gaussians: Gaussians) -> HeldViews | None:
    """Render views between the context views; None if no two cameras have similar viewing directions."""
    cameras = cameras_between(encoder.cameras.scene(0))
    if cameras is None:
        return None
    return HeldViews(cameras, render(gaussians, cameras, encoder.size).color)


def _distortion(
    encoder: SceneEncoder, config: OptimisationConfig, gaussians: Gaussians, held: HeldViews | None
) -> Float[Tensor, ""]:
    """Return D of the context views plus the weighted mean squared change of the held views."""
    rendered = render(gaussians, encoder.cameras.scene(0), encoder.size).color
    distortion = config.distortion(rendered, encoder.images[0], config.ssim_stride).mean()
    if held is None:
        return distortion
    moved = render(gaussians, held.cameras, encoder.size).color - held.images
    return distortion + config.held_weight * moved.square().mean()


def _gaussians(
    encoder: SceneEncoder,
    config: OptimisationConfig,
    state: Float[Tensor, "view channel h4 w4"],
    condition: RateCondition,
) -> Gaussians:
    """Predict the Gaussians of a state. Colours are constant: view-dependent colours would compensate depth errors.

    For few views, gradients skip the residual branches of the predictor. Gradients through these branches improve only
    the context views, and cost rate and time (docs/experiments.md).
    """
    is_direct = encoder.num_views <= config.max_views_of_direct_gradients
    with direct_gradients() if is_direct else nullcontext():
        return encoder.predict(state, condition).gaussians.scene(0)


@torch.enable_grad()
def _value_and_gradient(objective: Objective, y: Tensor) -> tuple[float, Tensor]:
    y = y.detach().requires_grad_()
    loss = objective(y)
    return float(loss.detach()), torch.autograd.grad(loss, y)[0]
