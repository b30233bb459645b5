"""Refinement: the latents of each stage follow the gradient of what they are for, before they are coded.

Networks guess in one pass what to send; the sender can render what its guess gives, so it can come closer to the
photographs. Published for images (Campos et al., "Content Adaptive Optimization for Neural Image Compression", 2019);
here the gradient comes through the receiver's networks and the rasteriser. Receivers see nothing of it. A few short
steps are worth half of the bytes, also at views between the photographs (docs/experiments.md).
"""

import math
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.coding.rate import estimate_latents, straight_through
from fecocodec.container.lagrangian import LAMBDA_MAX, LAMBDA_Q_MAX, STEPS_PER_E
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.nearby_cameras import cameras_between
from fecocodec.layers.blocks import direct_gradients
from fecocodec.receiver.state import State
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.distortion import distortions
from fecocodec.sender.steps import (
    CodedStage,
    Latents,
    MatchedViews,
    PreparedScene,
    Profile,
    analyse,
    start_state,
)

# Root mean square of the first step: in quantisation steps, as long ones cost bytes for little, and in latents as the
# networks have them, whose distance to what is best remains where quantisation is fine; the longer of the two.
STEP_SIZE, STEP_SIZE_UNSCALED = 0.12, 0.055
# What a bit is worth here, as a multiple of lambda at 1e-2 and as a power of lambda below: context views, which alone
# can be compared, gain more by a bit than those between them, the more so the finer they are coded.
RATE_WEIGHT, PRICE_EXPONENT = 2.0, 0.6
MOST_PIXELS = 2**20  # of all views: beyond it the gradient's memory would be several GiB
PIXELS_OF_ALL_STEPS = 2**19  # more are given one step, unless asked for: a step of eight views takes seconds
DEFAULT_STEPS, MANY_STEPS = 4, 16
FINE_LAMBDA_Q = (944, 256)  # below each, lambda 4e-4 and 2.7e-5, a step more is given: bits alone buy nothing there
MOST_DEFAULT_STEPS = DEFAULT_STEPS + len(FINE_LAMBDA_Q)
# Many steps overfit: what the context views gain, views between them lose, where geometry moves that nothing holds. So
# these are held where they were before the first step, at half the weight of the context views; few steps go too short
# a way to need it.
HELD_WEIGHT, MOST_UNHELD_STEPS = 0.5, MOST_DEFAULT_STEPS
# More views hold each other, and gradients through all of the predictor serve them better: by 0.5 dB for eight.
MOST_VIEWS_OF_DIRECT_GRADIENTS = 4
_SSIM_STRIDE = 3  # a quarter of the time of SSIM and its gradient, which are the same within a thousandth

Objective = Callable[[Float[Tensor, "view latent h8 w8"]], Float[Tensor, ""]]


@dataclass(frozen=True)
class HeldViews:
    """Views that refinement shall leave as they are."""

    cameras: Cameras
    images: Float[Tensor, "view 3 h w"]


def suitable_steps(scene: PreparedScene, lambda_q: int) -> int:
    """How many steps the last stage gets unless told: 4, 1 where the scene is large, 0 where the gradient takes too
    much memory; one more where lambda is small."""
    pixels, more = _num_pixels(scene), sum(lambda_q < fine for fine in FINE_LAMBDA_Q)
    return DEFAULT_STEPS + more if pixels <= PIXELS_OF_ALL_STEPS else 1 + more if pixels <= MOST_PIXELS else 0


def steps_of_first(num_steps: int) -> int:
    """How many steps stage 1 gets where stage 2 gets `num_steps`: half as many and one, as stage 2 mends what they
    leave.
    """
    return min(num_steps, num_steps // 2 + 1)


def refined_first_latents(
    profile: Profile, scene: PreparedScene, matched: MatchedViews, lambda_q: int, num_steps: int
) -> Latents:
    """Latents of stage 1 of all views, after so many steps."""
    latents = analyse(profile, matched.features, start_state(profile, scene), lambda_q, 1)
    return refine_stage(profile, scene, latents, None, lambda_q, num_steps)


def refine_stage(
    profile: Profile,
    scene: PreparedScene,
    latents: Latents,
    before: CodedStage | None,
    lambda_q: int,
    num_steps: int,
) -> Latents:
    """Latents of all views after `num_steps` of gradient descent on D + price R, with rounding straight through.

    D is measured on the context views as rendered after this stage, R estimated by the prior; where steps are many,
    views between them are held where they are. before: the first stage where this is the second, None for the first.
    lambda_q: of this stage. Scenes that are too large for the gradient's memory are left as they are.
    """
    if num_steps == 0 or _num_pixels(scene) > MOST_PIXELS:
        return latents
    lambdas = scene.lambda_of_views(lambda_q)
    stage, context, states = (1, None, None) if before is None else (2, before.latents.y_hat, before.after)
    price = price_of_rate(lambda_q) / _num_pixels(scene)

    def coded(y: Tensor) -> tuple[State, Tensor]:
        z = profile.sender.hyper_analysis(y.detach())
        estimate = estimate_latents(profile.receiver.prior, y, z, lambdas, stage, context, straight_through)
        after = profile.receiver.advance(states, estimate.y_hat, lambdas, stage)
        return after, estimate.bits_y.sum()

    held = None if num_steps <= MOST_UNHELD_STEPS else hold_views_between(profile, scene, coded(latents.y)[0])

    def objective(y: Tensor) -> Tensor:
        after, bits = coded(y)
        return distortion_of(profile, scene, after, held) + price * bits

    y = descend(latents.y, objective, num_steps, step_size(profile, lambda_q, stage))
    return Latents(y, profile.sender.hyper_analysis(y))


def price_of_rate(lambda_q: int) -> float:
    """Of a bit a pixel, in squared error; also for the first stage's lambda above 1e-2."""
    return RATE_WEIGHT * LAMBDA_MAX * math.exp(PRICE_EXPONENT * (lambda_q - LAMBDA_Q_MAX) / STEPS_PER_E)


def step_size(profile: Profile, lambda_q: int, stage: int) -> float:
    """Root mean square of the first step at this lambda, in quantisation steps."""
    device = next(profile.receiver.parameters()).device
    condition = profile.receiver.condition(torch.tensor([lambda_q], device=device), stage)
    return max(STEP_SIZE, STEP_SIZE_UNSCALED * float(condition.latent_gain))


def descend(
    start: Float[Tensor, "view latent h8 w8"], objective: Objective, num_steps: int, first_length: float
) -> Float[Tensor, "view latent h8 w8"]:
    """The start after some steps along the objective's gradient, whose lengths fall evenly from the first towards zero.

    Lengths are root mean squares. A step has its length whatever the gradient's. One that raises the objective is taken
    back, and the next are half as long; whether the last one does is not looked at, as looking takes half as long as a
    step.
    """
    y = best_y = start.detach()
    best, direction, longest = float("inf"), torch.zeros_like(y), first_length
    for number in range(num_steps):
        found, gradient = _value_and_gradient(objective, y)
        length = gradient.square().mean().sqrt()
        is_usable = bool(torch.isfinite(length)) and float(length) > 0.0
        if found < best and is_usable:
            best, best_y, direction = found, y, gradient / length
        else:
            longest /= 2
        y = best_y - longest * (1.0 - number / (num_steps + 1)) * direction
    return y


def distortion_of(
    profile: Profile, scene: PreparedScene, states: State, held: HeldViews | None = None
) -> Float[Tensor, ""]:
    """D of the context views as the receiver could render them from these states, and of held views if there are."""
    gaussians = _gaussians(profile, scene, states)
    rendered = render(gaussians, scene.cameras, _size(scene)).color
    distortion = distortions(rendered, scene.images, _SSIM_STRIDE).mean()
    if held is None:
        return distortion
    moved = render(gaussians, held.cameras, _size(scene)).color - held.images
    return distortion + HELD_WEIGHT * moved.square().mean()


@torch.no_grad()
def hold_views_between(profile: Profile, scene: PreparedScene, states: State) -> HeldViews | None:
    """Views between the context views, as the receiver could render them from these states; None where none are."""
    cameras = cameras_between(scene.cameras)
    if cameras is None:
        return None
    return HeldViews(cameras, render(_gaussians(profile, scene, states), cameras, _size(scene)).color)


def _gaussians(profile: Profile, scene: PreparedScene, states: State) -> Gaussians:
    """With colours that are the same from everywhere: where they depend on the direction, they hide errors of depth
    from the gradient. Where views are few it passes by what the predictor's side branches add: what latents gain
    through those suits the context views alone, and costs bytes and time (docs/experiments.md).
    """
    with direct_gradients() if scene.num_views <= MOST_VIEWS_OF_DIRECT_GRADIENTS else nullcontext():
        prediction = profile.receiver.predict(states.state, scene.cameras.as_batch(), states.condition)
    return prediction.gaussians.scene(0)


@torch.enable_grad()
def _value_and_gradient(objective: Objective, y: Tensor) -> tuple[float, Tensor]:
    y = y.detach().requires_grad_()
    loss = objective(y)
    return float(loss.detach()), torch.autograd.grad(loss, y)[0]


def _size(scene: PreparedScene) -> tuple[int, int]:
    return scene.images.shape[-2], scene.images.shape[-1]


def _num_pixels(scene: PreparedScene) -> int:
    return scene.num_views * scene.images.shape[-2] * scene.images.shape[-1]
