"""Train the network that proposes the steps of latent optimisation, on scenes that are encoded during training.

The latents after a step are the first latents plus all steps so far. So the gradient of the loss by these latents is
also the gradient by each of these steps, if the reaction of later steps to earlier ones is neglected. The next step
needs most of it anyway, so training costs little more than encoding. The loss also contains target views, and may
contain ST-LPIPS: the network learns steps that improve what encoding does not see.

The analysis transform learns to give what the steps end at, as far as it can be told without them.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.layers.blocks import RateCondition
from fecocodec.progress import Progress
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.lambda_roles import price_of_rate
from fecocodec.sender.latent_optimisation import (
    SSIM_STRIDE,
    STEP_SIZE,
    STEP_SIZE_UNSCALED,
    Latent,
    Objective,
    gaussians_of,
    step_size,
)
from fecocodec.sender.optimisation_config import OptimisationConfig, steps_of_first
from fecocodec.sender.scene import Guides
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.stages import Optimise, StageInputs, estimate_bits
from fecocodec.sender.step_network import StepNetwork
from fecocodec.training.batch import Batch
from fecocodec.training.loss import perceptual_distance

CONTEXT_SHARE = 0.4  # of the context views in the loss; the rest is the target views'
ANALYSIS_WEIGHT = 2e-4  # of the squared distance from g_a's latents to the optimised ones, in first steps
LAST_WEIGHT, OTHER_WEIGHT = 2.0, 0.25  # of the latents after the last step, which are coded, and after the others
OTHER_STEPS, OTHER_SHARE = (2, 9), 0.3  # numbers of steps other than those of encoding, and how often they are drawn

Parts = dict[str, float]
"""Parts of the loss: the loss, D of the context views, D of the target views, the logarithm of the bits."""


@dataclass(frozen=True)
class Evaluated:
    """Latents and what is computed from them, with a graph.

    objective: of encoding. target: D of the target views. perceptual: returns ST-LPIPS of one context view and one
    target view, drawn anew, weighted as their D.
    """

    y: Latent
    objective: Objective
    target: Float[Tensor, ""]
    perceptual: Callable[[], Float[Tensor, ""]]
    parts: Parts


@dataclass(frozen=True)
class StepLearner:
    """Optimises the latents of training batches, and adds to the gradients of the step network.

    Unlike in encoding, no step is undone, and no views are held.

    config: of the optimisation. generator: draws numbers of steps. perceptual_weight: of ST-LPIPS in the loss of the
    latents after the last step; the objective of encoding has no such term.
    """

    network: StepNetwork
    config: OptimisationConfig
    generator: torch.Generator
    perceptual_weight: float = 0.0
    _distances: list[Float[Tensor, ""]] = field(default_factory=list)

    def optimiser(
        self, encoder: SceneEncoder, batch: Batch, report: Callable[[dict[str, float]], None] = lambda _row: None
    ) -> Optimise:
        """Return the `optimise` argument of `SceneEncoder.run` for a batch, whose scenes are optimised one by one.

        The optimised latents pass no gradient to the sender. If they did, g_a would learn to rely on the steps: files
        without steps became 25% larger, and those with steps no better (docs/what_we_learned.md). It learns by
        `analysis_loss` instead. report: called for each stage of each scene with the change of `Parts` by its steps;
        names end in the stage's number.
        """
        pixels = encoder.num_pixels // len(batch.images)
        numbers = [self._draw_num_steps(pixels, int(lambda_q)) for lambda_q in batch.lambda_q]

        def optimise(y: Tensor, features: Tensor, inputs: StageInputs, _progress: Progress) -> Tensor:
            found = [
                self._optimise_scene(encoder, batch, scene, numbers[scene], (y, features, inputs), report)
                for scene in range(len(batch.images))
            ]
            optimised = torch.cat(found)
            if y.requires_grad:
                gains = inputs.condition.latent_gain.detach()
                lengths = torch.clamp_min(STEP_SIZE_UNSCALED * gains, STEP_SIZE)
                self._distances.append(((y - optimised) / lengths).square().mean())
            return optimised

        return optimise

    def analysis_loss(self) -> Float[Tensor, ""]:
        """Return ANALYSIS_WEIGHT times the mean squared distance from g_a's latents to the optimised ones.

        Distances are in lengths of the first step, and summed over the stages that were optimised since the last call.
        Without a gradient through the steps, this makes g_a give the mean of what steps end at (amortised inference).
        """
        total = torch.stack(self._distances).sum()
        self._distances.clear()
        return ANALYSIS_WEIGHT * total

    def _draw_num_steps(self, num_pixels: int, lambda_q: int) -> int:
        """Draw the number of steps of the last stage."""
        if float(torch.rand((), generator=self.generator)) < OTHER_SHARE:
            return OTHER_STEPS[int(torch.randint(len(OTHER_STEPS), (), generator=self.generator))]
        return self.config.steps_of_last(num_pixels, lambda_q)

    @torch.no_grad()
    def _optimise_scene(
        self,
        encoder: SceneEncoder,
        batch: Batch,
        scene: int,
        num_steps: int,
        given: tuple[Tensor, Tensor, StageInputs],
        report: Callable[[dict[str, float]], None],
    ) -> Latent:
        """Return the latents of one scene of the batch after the steps. given: y, F_k and what the stage has."""
        y, features, inputs = given
        items = slice(scene * encoder.num_views, (scene + 1) * encoder.num_views)
        alone = SceneEncoder(encoder.codec, encoder.images[scene : scene + 1], encoder.cameras.scene(scene).as_batch())
        own = _inputs_of(inputs, items)
        others = list(range(batch.num_context, batch.images.shape[1]))
        targets = Guides(batch.images[scene, others], batch.cameras.select(others).scene(scene))
        steps = num_steps if inputs.is_last else steps_of_first(num_steps)
        evaluate = partial(_evaluate, alone, self.config, own, targets)
        seen, first_length = (features[items].detach(), own.state, own.condition), step_size(own.condition)
        found, before, after = learn(
            self.network, evaluate, y[items], steps, first_length, seen, self.perceptual_weight
        )
        report({f"{name}{inputs.stage}": after[name] - before[name] for name in after})
        return found


def _inputs_of(inputs: StageInputs, items: slice) -> StageInputs:
    """Return the inputs of some items, without graph."""
    condition = RateCondition(inputs.condition.embedding[items].detach(), inputs.condition.latent_gain[items].detach())
    y_hat = None if inputs.y_hat is None else inputs.y_hat[items].detach()
    state = inputs.state[items].detach()
    return StageInputs(inputs.stage, inputs.is_last, inputs.lambda_q[items], condition, state, y_hat, inputs.fading)


def learn(
    network: StepNetwork,
    evaluate: Callable[[Latent], Evaluated],
    y: Latent,
    num_steps: int,
    first_length: float,
    given: tuple[Float[Tensor, "view channel h4 w4"], Float[Tensor, "view channel _ _"], RateCondition],
    perceptual_weight: float = 0.0,
) -> tuple[Latent, Parts, Parts]:
    """Take the steps that the network proposes, and add to its gradients.

    first_length: as in `descend`. given: F_k, S_{k-1} and the condition. perceptual_weight: see `StepLearner`.
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
        if proposed and is_last and perceptual_weight:
            (of_perceptual,) = _gradients(found.y, found.perceptual())
            arrows[-1] = arrows[-1] + perceptual_weight * of_perceptual
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
    encoder: SceneEncoder, config: OptimisationConfig, inputs: StageInputs, targets: Guides, y: Latent
) -> Evaluated:
    """Evaluate latents of a stage of a scene. targets: views beside the context views, in their frame."""
    y = y.detach().requires_grad_()
    estimated = estimate_bits(encoder.codec)(y, inputs)
    gaussians = gaussians_of(encoder, inputs, estimated.y_hat)

    def render_at(cameras: Cameras) -> Tensor:
        return render(gaussians, cameras, encoder.size).color

    rendered, between = render_at(encoder.cameras.scene(0)), render_at(targets.cameras)
    context = config.distortion(rendered, encoder.images[0], SSIM_STRIDE).mean()
    target = config.distortion(between, targets.images, SSIM_STRIDE).mean()
    bits = estimated.bits.sum()
    rate = price_of_rate(int(inputs.lambda_q[0])) / encoder.num_pixels * bits
    loss = CONTEXT_SHARE * context + (1.0 - CONTEXT_SHARE) * target + rate
    values = {"loss": loss, "context": context, "target": target, "log_bits": bits.clamp_min(1.0).log()}
    objective = Objective(context, rate, encoder.images[0] - rendered.detach())

    @torch.enable_grad()
    def perceptual() -> Tensor:
        pictures, truth = torch.cat((rendered, between)), torch.cat((encoder.images[0], targets.images))
        weights = pictures.new_full((len(pictures),), (1.0 - CONTEXT_SHARE) * len(pictures) / len(between))
        weights[: len(rendered)] = CONTEXT_SHARE * len(pictures) / len(rendered)
        return perceptual_distance(pictures[None], truth[None], len(rendered), weights)

    return Evaluated(y, objective, target, perceptual, {name: float(value.detach()) for name, value in values.items()})
