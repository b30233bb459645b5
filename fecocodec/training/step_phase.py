"""Last phase of training: the network that proposes steps of latent optimisation, alone.

Each scene is encoded as in use. The gradient of the loss at the latents after a step, which the next step needs nearly
in full, is also the gradient of what the network proposed, and of every step before as far as later steps do not react
to it. So a step of training costs little more than one of encoding. The loss sees target views, which the objective of
encoding does not: the network learns steps that help them, too.
"""

import math
import random
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.errors import InputError
from fecocodec.geometry.cameras import Cameras
from fecocodec.layers.blocks import RateCondition
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.codec import Codec
from fecocodec.sender.latent_coding import estimate_bits
from fecocodec.sender.latent_optimisation import Latent, Objective, gaussians_of
from fecocodec.sender.optimisation_config import DEFAULT, OptimisationConfig, price_of_rate, step_size, steps_of_first
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.stages import OnFraction, StageInputs
from fecocodec.sender.step_network import StepNetwork
from fecocodec.training.batch import Batch
from fecocodec.training.dataset import draw_batch
from fecocodec.training.log import mean_of_rows
from fecocodec.training.optimisation import clipped_step, cosine_with_warm_up
from fecocodec.training.trainer import Trainer

SCENES_OF_A_STEP = 2
CONTEXT_SHARE = 0.4  # of the context views in the loss; the rest is the target views'
LAST_WEIGHT, OTHER_WEIGHT = 2.0, 0.25  # of the latents after the last step, which are coded, and after the others
OTHER_STEPS, OTHER_SHARE = (2, 9), 0.3  # numbers of steps other than those of encoding, and how often they are drawn
AVERAGE_DECAY = 0.98
WARM_UP, LOG_EVERY = 30, 25  # updates

Parts = dict[str, float]
"""Of the loss: itself, D of context and of target views, the logarithm of the bits."""


@dataclass(frozen=True)
class StepPhase:
    """Settings of the phase. num_updates: of the network, each by two scenes a process."""

    num_updates: int
    learning_rate: float = 1e-3
    optimisation: OptimisationConfig = DEFAULT

    def learning_rate_at(self, update: int) -> float:
        """Linear warm-up, then cosine to zero."""
        return cosine_with_warm_up(self.learning_rate, update, self.num_updates, WARM_UP)


@dataclass(frozen=True)
class Targets:
    """Views of one scene beside its context views, in their frame."""

    images: Float[Tensor, "view 3 h w"]
    cameras: Cameras


@dataclass(frozen=True)
class Evaluated:
    """Latents and what is computed from them, with a graph. objective: of encoding. target: D of the target views."""

    y: Latent
    objective: Objective
    target: Float[Tensor, ""]
    parts: Parts


def train_step_network(trainer: Trainer, phase: StepPhase) -> Iterator[dict[str, float]]:
    """Train the step network, starting at a trainer's averaged weights, then save its checkpoint.

    Every `LOG_EVERY` updates, yields the number of updates, the number skipped because gradients were not finite, and
    what the steps of each stage change: the loss, D of context and of target views, and the logarithm of the bits. The
    checkpoint is written only at the end. Raises InputError for a sender without this network.
    """
    trainer.networks.load_state_dict(trainer.average)
    network = trainer.sender.steps
    if network is None:
        raise InputError("This sender has no network that proposes steps; choose the configuration compact.")
    learning = [parameter for parameter in trainer.networks.parameters() if parameter.requires_grad]
    trainer.networks.requires_grad_(False)
    network.requires_grad_(True)
    average = {name: value.clone() for name, value in network.state_dict().items()}
    optimiser = torch.optim.AdamW(network.parameters(), lr=1.0, betas=(0.9, 0.99), weight_decay=1e-4)
    rng = random.Random(trainer.generator.initial_seed())
    window: list[dict[str, float]] = []
    num_skipped = 0
    for update in range(phase.num_updates):
        optimiser.zero_grad(set_to_none=True)
        for _ in range(SCENES_OF_A_STEP):
            window.append(learn_from_scene(trainer, network, phase.optimisation, rng))
        if math.isfinite(clipped_step(optimiser, network, phase.learning_rate_at(update))):
            decay = min(AVERAGE_DECAY, (1 + update) / (10 + update))
            torch._foreach_lerp_(list(average.values()), list(network.state_dict().values()), 1.0 - decay)
        else:
            num_skipped += 1
        if (update + 1) % LOG_EVERY == 0 or update + 1 == phase.num_updates:
            yield {"step": float(update + 1), "skipped": float(num_skipped)} | mean_of_rows(window)
            window = []
    network.load_state_dict(average)
    for parameter in learning:
        parameter.requires_grad_(True)
    trainer.begin_average()
    trainer.save(trainer.checkpoint)


def learn_from_scene(
    trainer: Trainer, network: StepNetwork, config: OptimisationConfig, rng: random.Random
) -> dict[str, float]:
    """Encode a scene that is drawn from the trainer's sources, and add to the gradients of the network.

    Returns what the steps of each stage change, see `train_step_network`.
    """
    batch = _draw(trainer)
    context = list(range(batch.num_context))
    encoder = SceneEncoder(
        Codec(trainer.sender, trainer.receiver, b""), batch.images[:, context], batch.cameras.select(context)
    )
    others = list(range(batch.num_context, batch.images.shape[1]))
    targets = Targets(batch.images[0, others], batch.cameras.select(others).scene(0))
    num_steps = config.steps_of_last(encoder.num_pixels, int(batch.lambda_q[0]))
    if rng.random() < OTHER_SHARE:
        num_steps = rng.choice(OTHER_STEPS)
    changes: dict[str, float] = {}

    def optimise(y: Tensor, features: Tensor, inputs: StageInputs, _on_fraction: OnFraction) -> Tensor:
        steps = num_steps if inputs.is_last else steps_of_first(num_steps)
        evaluate = partial(_evaluate, encoder, config, inputs, targets)
        given = features, inputs.state, inputs.condition
        y, before, after = learn(network, evaluate, y, steps, step_size(config, inputs.condition), given)
        changes.update({f"{name}{inputs.stage}": after[name] - before[name] for name in after})
        return y

    with torch.no_grad():
        encoder.run(batch.lambda_q, 2, estimate_bits(encoder.codec), optimise)
    return changes


def _draw(trainer: Trainer) -> Batch:
    """Draw a batch of one scene."""
    configuration = trainer.settings.configuration
    shape = replace(configuration.shapes.draw(trainer.generator), num_scenes=1)
    share = configuration.schedule.photograph_share[1]
    return draw_batch(trainer.sources, trainer.generator, shape, share, configuration.lambda_q_range)


def learn(
    network: StepNetwork,
    evaluate: Callable[[Latent], Evaluated],
    y: Latent,
    num_steps: int,
    first_length: float,
    given: tuple[Float[Tensor, "view channel h4 w4"], Float[Tensor, "view channel _ _"], RateCondition],
) -> tuple[Latent, Parts, Parts]:
    """Take the steps that the network proposes, and add to its gradients.

    Steps are not undone, unlike in encoding. first_length: as in `descend`. given: F_k, S_{k-1} and the condition.
    Returns y after the last step, and the parts of the loss before the first and after the last step.
    """
    features, state, condition = given
    with torch.enable_grad():
        known = network.prepare(features, state)
    y, previous = y.detach(), torch.zeros_like(y)
    proposed: list[Latent] = []
    arrows: list[Latent] = []  # gradients of the loss after each step
    ends: list[Parts] = []
    for number in range(num_steps + 1):
        is_last = number == num_steps
        found = evaluate(y)
        if number == 0 or is_last:
            ends.append(found.parts)
        of_distortion, of_rate = _gradients(found.y, found.objective.distortion, found.objective.rate)
        if proposed:
            (of_target,) = _gradients(found.y, found.target)
            arrows.append(CONTEXT_SHARE * of_distortion + (1.0 - CONTEXT_SHARE) * of_target + of_rate)
        if is_last:
            break
        gradient = of_distortion + of_rate
        length = gradient.square().mean().sqrt().clamp_min(torch.finfo(gradient.dtype).tiny)
        left = 1.0 - number / (num_steps + 1)
        with torch.enable_grad():
            seen = gradient / length, of_rate / length, y, previous, left, found.objective.errors
            step = network(*seen, known, condition)
            proposed.append(y + first_length * left * step)
        y, previous = proposed[-1].detach(), step.detach()
    if proposed:
        torch.autograd.backward(proposed, _sums_of_later(arrows))
    return y, ends[0], ends[-1]


def _sums_of_later(arrows: list[Latent]) -> list[Latent]:
    """Return, for each step, the weighted sum of the gradients after it and after all later steps."""
    sums: list[Latent] = []
    for arrow in reversed(arrows):
        sums.append(sums[-1] + OTHER_WEIGHT * arrow if sums else LAST_WEIGHT * arrow)
    return sums[::-1]


def _gradients(y: Latent, *values: Float[Tensor, ""]) -> list[Latent]:
    """Return the gradients of values by the latents, with zeros in place of what is not finite."""
    found = (torch.autograd.grad(value, y, retain_graph=True)[0] for value in values)
    return [gradient.nan_to_num(0.0, 0.0, 0.0) for gradient in found]


@torch.enable_grad()
def _evaluate(
    encoder: SceneEncoder, config: OptimisationConfig, inputs: StageInputs, targets: Targets, y: Latent
) -> Evaluated:
    """Evaluate latents of a stage of a scene."""
    y = y.detach().requires_grad_()
    estimated = estimate_bits(encoder.codec)(y, inputs)
    gaussians = gaussians_of(encoder, config, inputs, estimated.y_hat)

    def render_at(cameras: Cameras) -> Tensor:
        return render(gaussians, cameras, encoder.size).color

    rendered = render_at(encoder.cameras.scene(0))
    context = config.distortion(rendered, encoder.images[0], config.ssim_stride).mean()
    target = config.distortion(render_at(targets.cameras), targets.images, config.ssim_stride).mean()
    bits = estimated.bits.sum()
    rate = price_of_rate(config, int(inputs.lambda_q[0])) / encoder.num_pixels * bits
    loss = CONTEXT_SHARE * context + (1.0 - CONTEXT_SHARE) * target + rate
    values = {"loss": loss, "context": context, "target": target, "log_bits": bits.clamp_min(1.0).log()}
    objective = Objective(context, rate, encoder.images[0] - rendered.detach())
    return Evaluated(y, objective, target, {name: float(value.detach()) for name, value in values.items()})
