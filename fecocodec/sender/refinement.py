"""Refinement of the second stage: its latents follow the gradient of what they are for, before they are coded.

Networks guess in one pass what is missing; the sender can render what its guess gives, so it can come closer to the
photographs. Published for images (Campos et al., "Content Adaptive Optimization for Neural Image Compression", 2019);
here the gradient comes through the receiver's networks and the rasteriser. Receivers see nothing of it. Two short steps
are worth two fifths of the bytes, also at views between the photographs (docs/experiments.md).
"""

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.coding.rate import estimate_latents, straight_through
from fecocodec.container.lagrangian import dequantise_lambda
from fecocodec.receiver.view_states import ViewStates, update_views
from fecocodec.sender.distortion import distortions
from fecocodec.sender.steps import CodedStage, Latents, PreparedScene, Profile, stage_rendering

# Root mean square of the first step: in quantisation steps, as long ones cost bytes for little, and in latents as the
# networks have them, whose distance to what is best remains where quantisation is fine; the longer of the two.
STEP_SIZE, STEP_SIZE_UNSCALED = 0.12, 0.055
RATE_WEIGHT = 2.0  # of lambda R: context views, which alone can be compared, gain more by a bit than those between them
MOST_PIXELS = 2**20  # padded, of all views: beyond it the gradient's memory would be several GiB
PIXELS_OF_TWO_STEPS = 2**19  # more are given one step, unless asked for: a step of eight views takes seconds
_SSIM_STRIDE = 3  # a quarter of the time of SSIM and its gradient, which are the same within a thousandth
FINE_LAMBDA_Q = 256  # below it, lambda 2.7e-5, a step more is given: bits alone buy nothing there

Objective = Callable[[Float[Tensor, "view latent h8 w8"]], Float[Tensor, ""]]


def suitable_steps(scene: PreparedScene, lambda_q: int) -> int:
    """How many steps a scene gets unless told: 2, 1 where it is large, 0 where the gradient takes too much memory; one
    more where lambda is small."""
    pixels, more = _num_pixels(scene), 1 if lambda_q < FINE_LAMBDA_Q else 0
    return 2 + more if pixels <= PIXELS_OF_TWO_STEPS else 1 + more if pixels <= MOST_PIXELS else 0


def refine_second_stage(
    profile: Profile,
    scene: PreparedScene,
    latents: Latents,
    first: CodedStage,
    lambda_q: int,
    num_steps: int | None = None,
) -> Latents:
    """Latents of all views after `num_steps` of gradient descent on D + 2 lambda R, with rounding straight through.

    D is measured on the context views as rendered after stage 2, R estimated by the prior. num_steps: None for those
    that suit the scene and lambda; scenes that are too large for the gradient's memory are left as they are.
    """
    num_steps = suitable_steps(scene, lambda_q) if num_steps is None else num_steps
    if num_steps == 0 or _num_pixels(scene) > MOST_PIXELS:
        return latents
    lambdas, every_view = scene.lambda_of_views(lambda_q), tuple(range(scene.num_views))
    price = RATE_WEIGHT * dequantise_lambda(lambda_q) / _num_pixels(scene)

    def objective(y: Tensor) -> Tensor:
        z = profile.sender.hyper_analysis(y.detach())
        coded = estimate_latents(profile.receiver.prior, y, z, lambdas, 2, first.latents.y_hat, straight_through)
        states = update_views(profile.receiver, first.after, coded.y_hat, lambdas, 2, every_view)
        return distortion_of(profile, scene, states) + price * coded.bits_y.sum()

    y = descend(latents.y, objective, num_steps, step_size(profile, lambda_q))
    return Latents(y, profile.sender.hyper_analysis(y))


def step_size(profile: Profile, lambda_q: int) -> float:
    """Root mean square of the first step at this lambda, in quantisation steps."""
    device = next(profile.receiver.parameters()).device
    condition = profile.receiver.condition(torch.tensor([lambda_q], device=device), 2)
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


def distortion_of(profile: Profile, scene: PreparedScene, states: ViewStates) -> Float[Tensor, ""]:
    """D of the context views as the receiver could render them from these states."""
    return distortions(stage_rendering(profile, scene, states).color, scene.images, _SSIM_STRIDE).mean()


@torch.enable_grad()
def _value_and_gradient(objective: Objective, y: Tensor) -> tuple[float, Tensor]:
    y = y.detach().requires_grad_()
    loss = objective(y)
    return float(loss.detach()), torch.autograd.grad(loss, y)[0]


def _num_pixels(scene: PreparedScene) -> int:
    return scene.num_views * scene.images.shape[-2] * scene.images.shape[-1]
