"""Optimise the latents for D + price * R before coding, by gradient descent through the receiver and the rasteriser.

Follows Campos et al., "Content Adaptive Optimization for Neural Image Compression", 2019, who optimise latents of
images. The stream format and the receiver do not change.
"""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras, cameras_between
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.layers.blocks import RateCondition, direct_gradients
from fecocodec.progress import Progress
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.lambda_roles import MANY_VIEWS, price_of_rate
from fecocodec.sender.optimisation_config import OptimisationConfig
from fecocodec.sender.references import Pictures, References
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.stages import EstimatedLatent, LatentCoder, Optimise, StageInputs
from fecocodec.sender.step_network import StepNetwork

Latent = Float[Tensor, "view latent h8 w8"]
# RMS of the first step, in quantisation steps and in units of y / gain. The larger of the two is used: the first limits
# the bits that a step adds, the second takes over when quantisation is fine.
STEP_SIZE, STEP_SIZE_UNSCALED = 0.12, 0.055
# With more steps, changes of renderings between the context views are penalised: many steps overfit the context views.
MAX_STEPS_UNHELD, HELD_WEIGHT = 8, 0.5
# RMS of a step at one position, from four views on. Where views contradict each other, gradients are many times the
# usual, and colours turn into confetti. On 20 training captures with guides: 2.3% fewer bytes, 0.0 dB at new views.
LONGEST_LOCAL_STEP = 3.5
MAX_VIEWS_OF_DIRECT_GRADIENTS = 4  # with more, gradients also pass through the residual branches of the predictor
SSIM_STRIDE = 3  # of the windows, see `metrics.ssim`


@dataclass(frozen=True)
class Objective:
    """D + price * R at some latents, with a graph. rate: price * R. errors: photographs minus renderings, no graph."""

    distortion: Float[Tensor, ""]
    rate: Float[Tensor, ""]
    errors: Pictures


@dataclass(frozen=True)
class Slope:
    """Gradient of the objective, divided by its RMS. of_rate: of the rate term, divided by the same RMS.

    errors: as in `Objective`.
    """

    gradient: Latent
    of_rate: Latent
    errors: Pictures


Evaluate = Callable[[Latent], Objective]
Propose = Callable[[Slope, Latent, Latent, float], Latent]
"""(slope, y, previous step, share of the steps that remain) -> step, to be multiplied by its present length."""


def optimiser(
    encoder: SceneEncoder,
    config: OptimisationConfig,
    estimate: LatentCoder[EstimatedLatent],
    num_steps: tuple[int, int],
) -> Optimise:
    """Return the `optimise` argument of `SceneEncoder.run` for one scene: descent on D + price * R.

    D is the mean distortion of context views and guides, rendered after a stage. R is the rate that `estimate` returns,
    a differentiable coder, (y, inputs) -> y_hat and bits. num_steps: as in `Improvements`.
    """
    of_picture = partial(config.distortion, ssim_stride=SSIM_STRIDE)

    def optimise(y: Tensor, features: Tensor, inputs: StageInputs, progress: Progress) -> Tensor:
        steps = num_steps[inputs.is_last]
        if steps == 0:
            return y
        price = price_of_rate(int(inputs.lambda_q[0])) / encoder.num_pixels
        references = References.of(encoder).taught(inputs.stage)  # the same in all steps, whose objectives are compared
        photographs, held = references.pictures, None
        if steps > MAX_STEPS_UNHELD and encoder.guides is None:
            held = hold_views_between(encoder, gaussians_of(encoder, inputs, estimate(y, inputs).y_hat))

        num_evaluated = 0

        def evaluate(y: Tensor) -> Objective:
            nonlocal num_evaluated
            progress(f"optimising stage {inputs.stage}", num_evaluated / steps)
            num_evaluated += 1
            estimated = estimate(y, inputs)
            gaussians = gaussians_of(encoder, inputs, estimated.y_hat)
            distortion, pictures = references.distortion(gaussians, of_picture)
            if held is not None:
                cameras, images = held
                change = render(gaussians, cameras, encoder.size).color - images
                distortion = distortion + HELD_WEIGHT * change.square().mean()
            errors = (photographs - pictures)[: encoder.num_views]  # on white, if there is a choice
            return Objective(distortion, price * estimated.bits.sum(), errors)

        propose = proposer(encoder, features, inputs, config.sharpness)
        return descend(y, evaluate, steps, step_size(inputs.condition), propose)

    return optimise


def step_size(condition: RateCondition) -> float:
    """Return the RMS of the first step, in quantisation steps."""
    return max(STEP_SIZE, STEP_SIZE_UNSCALED * float(condition.latent_gain[0]))


@torch.no_grad()
def proposer(
    encoder: SceneEncoder, features: Float[Tensor, "view channel h4 w4"], inputs: StageInputs, sharpness: float = 0.0
) -> Propose:
    """Return the function that proposes steps: the sender's step network, or the negative gradient if it has none.

    features: F_k. sharpness: see `OptimisationConfig`.
    """
    network = encoder.codec.sender.steps
    if network is None:
        propose: Propose = against_gradient
    else:
        if (sharp := encoder.codec.sender.sharp_steps) is not None:
            network = network.blended(sharp, sharpness)
        propose = _by_network(network, network.prepare(features, inputs.state), inputs.condition)
    return _limited(propose) if encoder.num_views >= MANY_VIEWS else propose


def _by_network(network: StepNetwork, known: Tensor, condition: RateCondition) -> Propose:
    @torch.no_grad()
    def propose(slope: Slope, y: Tensor, previous: Tensor, left: float) -> Tensor:
        seen = slope.gradient, slope.of_rate, y, previous, left, slope.errors
        step: Tensor = network(*seen, known, condition)
        return step

    return propose


def _limited(propose: Propose) -> Propose:
    """Return the same proposals, shortened where their RMS over the channels is above LONGEST_LOCAL_STEP."""

    def shortened(slope: Slope, y: Tensor, previous: Tensor, left: float) -> Tensor:
        step = propose(slope, y, previous, left)
        local = step.square().mean(dim=1, keepdim=True).sqrt()
        return step * (LONGEST_LOCAL_STEP / local).clamp(max=1.0)

    return shortened


def against_gradient(slope: Slope, y: Tensor, previous: Tensor, left: float) -> Tensor:
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
def hold_views_between(encoder: SceneEncoder, gaussians: Gaussians) -> tuple[Cameras, Pictures] | None:
    """Return views between the context views, whose changes are penalised, as they are rendered before the first step.

    None if no two cameras have similar viewing directions.
    """
    cameras = cameras_between(encoder.cameras.scene(0))
    return None if cameras is None else (cameras, render(gaussians, cameras, encoder.size).color)


def gaussians_of(encoder: SceneEncoder, inputs: StageInputs, y_hat: Float[Tensor, "view latent h8 w8"]) -> Gaussians:
    """Return the Gaussians of a stage, with the fading before it.

    Colours are constant: colours by direction would compensate depth errors. For few views, gradients skip the residual
    branches of the predictor. Gradients through these branches improve only the context views, and cost rate and time.
    """
    is_direct = encoder.num_views <= MAX_VIEWS_OF_DIRECT_GRADIENTS
    with direct_gradients() if is_direct else nullcontext():
        prediction = encoder.predict(encoder.update(inputs, y_hat), inputs.condition)
    return encoder.emit(prediction, inputs.fading, has_fitted_colours=False)


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
