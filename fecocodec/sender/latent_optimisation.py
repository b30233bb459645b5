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

Latent = Float[Tensor, "view latent h8 w8"]
Objective = Callable[[Latent], Float[Tensor, ""]]
Propose = Callable[[Latent, Latent, Latent, float], Latent]
"""(gradient of RMS 1, y, previous step, share of the steps that is left) -> step, in units of its present length."""


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
    y: Latent,
    num_steps: int,
    on_fraction: OnFraction = lambda _fraction: None,
) -> Latent:
    """Return y of one stage after `num_steps` steps of descent on D + price * R.

    D is the distortion of the context views, rendered after this stage. R is the rate that `estimate` returns.
    on_fraction: called before each step.
    """
    if num_steps == 0:
        return y
    lambda_q = int(inputs.lambda_q[0])
    price = price_of_rate(config, lambda_q) / encoder.num_pixels

    held = None
    if num_steps > config.max_steps_unheld:
        held = hold_views_between(encoder, gaussians_of(encoder, config, inputs, estimate(y, inputs).y_hat))

    num_evaluated = 0

    def objective(y: Tensor) -> Tensor:
        nonlocal num_evaluated
        on_fraction(num_evaluated / num_steps)
        num_evaluated += 1
        estimated = estimate(y, inputs)
        distortion = _distortion(encoder, config, gaussians_of(encoder, config, inputs, estimated.y_hat), held)
        return distortion + price * estimated.bits.sum()

    return descend(y, objective, num_steps, step_size(config, inputs.condition), proposer(encoder, inputs.condition))


def proposer(encoder: SceneEncoder, condition: RateCondition) -> Propose:
    """Return what proposes steps: the sender's network, if it has one, else the direction against the gradient."""
    network = encoder.codec.sender.steps
    if network is None:
        return against_gradient

    @torch.no_grad()
    def propose(gradient: Tensor, y: Tensor, previous: Tensor, left: float) -> Tensor:
        step: Tensor = network(gradient, y, previous, left, condition)
        return step

    return propose


def against_gradient(gradient: Tensor, y: Tensor, previous: Tensor, left: float) -> Tensor:
    """Return the negative gradient."""
    return -gradient


def descend(
    start: Latent, objective: Objective, num_steps: int, first_length: float, propose: Propose = against_gradient
) -> Latent:
    """Run normalised gradient descent from `start`, or descent by proposed steps, whose length decreases linearly to 0.

    first_length: RMS of the first step along the gradient, in units of y. A step that increases the objective is
    undone, and the following steps are halved. The last step is not checked, because a check takes half as long as a
    step.
    """
    y = best_y = start.detach()
    best, step, longest = float("inf"), torch.zeros_like(y), first_length
    for number in range(num_steps):
        value, gradient = _value_and_gradient(objective, y)
        length, left = gradient.square().mean().sqrt(), 1.0 - number / (num_steps + 1)
        is_usable = bool(torch.isfinite(length)) and float(length) > 0.0
        if value < best and is_usable:
            best, best_y, step = value, y, propose(gradient / length, y, step, left)
        else:
            longest /= 2
        y = best_y + longest * left * step
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


def gaussians_of(
    encoder: SceneEncoder, config: OptimisationConfig, inputs: StageInputs, y_hat: Float[Tensor, "view latent h8 w8"]
) -> Gaussians:
    """Predict the Gaussians of a stage, faded if there is fading.

    Colours are constant: view-dependent colours would compensate depth errors. For few views, gradients skip the
    residual branches of the predictor. Gradients through these branches improve only the context views, and cost rate
    and time (docs/experiments.md).
    """
    is_direct = encoder.num_views <= config.max_views_of_direct_gradients
    with direct_gradients() if is_direct else nullcontext():
        gaussians = encoder.predict(encoder.update(inputs, y_hat), inputs.condition).gaussians.scene(0)
    return gaussians if inputs.fading is None else inputs.fading.faded(gaussians)


@torch.enable_grad()
def _value_and_gradient(objective: Objective, y: Tensor) -> tuple[float, Tensor]:
    y = y.detach().requires_grad_()
    loss = objective(y)
    return float(loss.detach()), torch.autograd.grad(loss, y)[0]
