"""Optimise the latents for D + price * R before coding, by gradient descent through the receiver and the rasteriser.

Follows Campos et al., "Content Adaptive Optimization for Neural Image Compression", 2019, who optimise latents of
images. The stream format and the receiver do not change. Results: docs/what_we_learned.md.
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
from fecocodec.layers.blocks import direct_gradients
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.latent_coding import EstimatedLatent
from fecocodec.sender.optimisation_config import OptimisationConfig, price_of_rate, step_size, steps_of_first
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.stages import LatentCoder, OnFraction, Optimise, StageInputs

Latent = Float[Tensor, "view latent h8 w8"]


@dataclass(frozen=True)
class Objective:
    """D + price * R at some latents, with a graph. rate: price * R. errors: photographs minus renderings, no graph."""

    distortion: Float[Tensor, ""]
    rate: Float[Tensor, ""]
    errors: Float[Tensor, "view 3 h w"]


@dataclass(frozen=True)
class Slope:
    """Gradient of the objective, divided by its RMS. of_rate: of the rate term, divided by the same RMS.

    errors: as in `Objective`.
    """

    gradient: Latent
    of_rate: Latent
    errors: Float[Tensor, "view 3 h w"]


Evaluate = Callable[[Latent], Objective]
Propose = Callable[[Slope, Latent, Latent, float], Latent]
"""(slope, y, previous step, share of the steps that remain) -> step, to be multiplied by its present length."""


@dataclass(frozen=True)
class HeldViews:
    """Views between the context views, as rendered before the optimisation; changes of them are penalised."""

    cameras: Cameras
    images: Float[Tensor, "view 3 h w"]


def optimiser(
    encoder: SceneEncoder, config: OptimisationConfig, estimate: LatentCoder[EstimatedLatent], lambda_q: int
) -> Optimise:
    """Return the `optimise` argument of `SceneEncoder.run` for one scene whose last stage is coded at `lambda_q`.

    estimate: differentiable coder, (y, inputs) -> y_hat and bits.
    """
    num_steps = config.steps_of_last(encoder.num_pixels, lambda_q)

    def optimise(y: Tensor, features: Tensor, inputs: StageInputs, on_fraction: OnFraction) -> Tensor:
        steps = num_steps if inputs.is_last else steps_of_first(num_steps)
        if steps == 0:
            return y
        propose = proposer(encoder, features, inputs, config.sharpness)
        return optimise_latents(encoder, config, estimate, inputs, y, steps, propose, on_fraction)

    return optimise


def optimise_latents(
    encoder: SceneEncoder,
    config: OptimisationConfig,
    estimate: LatentCoder[EstimatedLatent],
    inputs: StageInputs,
    y: Latent,
    num_steps: int,
    propose: Propose,
    on_fraction: OnFraction = lambda _fraction: None,
) -> Latent:
    """Return y of one stage after `num_steps` steps, at least one, of descent on D + price * R.

    D is the distortion of the context views, rendered after this stage. R is the rate that `estimate` returns.
    propose: see `proposer`. on_fraction: called before each step.
    """
    lambda_q = int(inputs.lambda_q[0])
    price, photographs = price_of_rate(config, lambda_q) / encoder.num_pixels, encoder.photographs

    held = None
    if num_steps > config.max_steps_unheld:
        held = hold_views_between(encoder, gaussians_of(encoder, config, inputs, estimate(y, inputs).y_hat))

    num_evaluated = 0

    def evaluate(y: Tensor) -> Objective:
        nonlocal num_evaluated
        on_fraction(num_evaluated / num_steps)
        num_evaluated += 1
        estimated = estimate(y, inputs)
        gaussians = gaussians_of(encoder, config, inputs, estimated.y_hat)
        pictures = encoder.pictures(render(gaussians, encoder.cameras.scene(0), encoder.size))
        distortion = config.distortion(pictures, photographs, config.ssim_stride).mean()
        if held is not None:
            distortion = distortion + config.held_weight * _change(gaussians, held, encoder.size)
        errors = (photographs - pictures.detach())[: encoder.num_views]  # on white, if there is a choice
        return Objective(distortion, price * estimated.bits.sum(), errors)

    return descend(y, evaluate, num_steps, step_size(config, inputs.condition), propose)


@torch.no_grad()
def proposer(
    encoder: SceneEncoder, features: Float[Tensor, "view channel h4 w4"], inputs: StageInputs, sharpness: float = 0.0
) -> Propose:
    """Return the function that proposes steps: the sender's step network, or the negative gradient if it has none.

    features: F_k. sharpness: see `OptimisationConfig`.
    """
    network = encoder.codec.sender.steps
    if network is None:
        return against_gradient
    if (sharp := encoder.codec.sender.sharp_steps) is not None:
        network = network.blended(sharp, sharpness)
    known = network.prepare(features, inputs.state)

    @torch.no_grad()
    def propose(slope: Slope, y: Tensor, previous: Tensor, left: float) -> Tensor:
        seen = slope.gradient, slope.of_rate, y, previous, left, slope.errors
        step: Tensor = network(*seen, known, inputs.condition)
        return step

    return propose


def against_gradient(slope: Slope, y: Tensor, previous: Tensor, left: float) -> Tensor:
    """Return the negative gradient."""
    return -slope.gradient


def descend(
    start: Latent, evaluate: Evaluate, num_steps: int, first_length: float, propose: Propose = against_gradient
) -> Latent:
    """Descend from `start` by the steps that `propose` returns.

    first_length: RMS of the first step along the gradient, in units of y. Lengths decrease linearly, to 2 / (n + 1) of
    it for the last of n steps. After a step that increases the objective, descent goes back to the best y, halves all
    further lengths, and takes the same step again. The last step is not checked: a check takes half as long as a step.
    """
    y = best_y = start.detach()
    best, step, longest = float("inf"), torch.zeros_like(y), first_length
    for number in range(num_steps):
        value, slope = _value_and_slope(evaluate, y)
        left = 1.0 - number / (num_steps + 1)
        if value < best and slope is not None:
            best, best_y, step = value, y, propose(slope, y, step, left)
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


def _change(gaussians: Gaussians, held: HeldViews, size: tuple[int, int]) -> Float[Tensor, ""]:
    """Return the mean squared change of the held views."""
    return (render(gaussians, held.cameras, size).color - held.images).square().mean()


def gaussians_of(
    encoder: SceneEncoder, config: OptimisationConfig, inputs: StageInputs, y_hat: Float[Tensor, "view latent h8 w8"]
) -> Gaussians:
    """Predict the Gaussians of a stage, faded if there is fading, without those that a cut-out does not emit.

    Those behind near surfaces are added, as by a decoder.

    Colours are constant: view-dependent colours would compensate depth errors. For few views, gradients skip the
    residual branches of the predictor. Gradients through these branches improve only the context views, and cost rate
    and time (docs/what_we_learned.md).
    """
    is_direct = encoder.num_views <= config.max_views_of_direct_gradients
    with direct_gradients() if is_direct else nullcontext():
        prediction = encoder.predict(encoder.update(inputs, y_hat), inputs.condition)
    gaussians = encoder.emitted(prediction.gaussians.scene(0))
    if inputs.fading is not None:
        gaussians = inputs.fading.faded(gaussians)
    return encoder.completed(gaussians, prediction)


@torch.enable_grad()
def _value_and_slope(evaluate: Evaluate, y: Tensor) -> tuple[float, Slope | None]:
    """Return the objective and its slope; None if the gradient is zero or not finite."""
    y = y.detach().requires_grad_()
    objective = evaluate(y)
    (of_distortion,) = torch.autograd.grad(objective.distortion, y, retain_graph=True)
    of_rate = torch.zeros_like(y)
    if objective.rate.requires_grad:  # latents that are not coded have no rate
        (of_rate,) = torch.autograd.grad(objective.rate, y)
    gradient = of_distortion + of_rate
    length = gradient.square().mean().sqrt()
    value = float((objective.distortion + objective.rate).detach())
    if not (bool(torch.isfinite(length)) and float(length) > 0.0):
        return value, None
    return value, Slope(gradient / length, of_rate / length, objective.errors)
