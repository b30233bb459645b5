"""A phase after the schedule: the receiver's networks alone, on latents as senders refine them.

In the schedule latents come from one pass of the networks; senders refine them, until the receiver shows the context
views as well as it can. What that makes of the views between them only a receiver that has met such latents can learn.
They are coded with averaged weights, as a sender codes them, and no gradient goes through the coding (as in the
first-order variant of Finn et al., "Model-agnostic meta-learning for fast adaptation of deep networks", 2017). So a
scene that took seconds to code is learnt from several times.
"""

import copy
import math
import random
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.coding.camera_packing import pack
from fecocodec.receiver.model import Receiver
from fecocodec.receiver.view_states import ViewStates, update_views
from fecocodec.rendering.rasterizer import render
from fecocodec.sender.encode import code_stages
from fecocodec.sender.steps import PreparedScene, Profile, match_views
from fecocodec.training.batch_shapes import BatchShape
from fecocodec.training.dataset import draw_batch
from fecocodec.training.log import mean_of_rows
from fecocodec.training.loop import ALONE_EVERY, Trainer
from fecocodec.training.objective import Batch, MatchedDisparity, StageOutcome, loss_of, with_targets
from fecocodec.training.optimisation import follow_gradients, warmed_cosine

AVERAGE_DECAY = 0.99
LAMBDAS_OF_A_SCENE = 2  # matching is the same for all
DISPARITY_WEIGHT = 0.7  # as in the middle of the schedule
LOG_EVERY = 50  # steps


@dataclass(frozen=True)
class ReceiverPhase:
    """scenes_of_a_step: of each process. fresh_share: of them, how many are coded for it; the others were before.
    least_scenes: coded, of each shape, before any is learnt from again.
    """

    num_steps: int
    learning_rate: float = 5e-5
    scenes_of_a_step: int = 4
    fresh_share: float = 0.13
    least_scenes: int = 8

    def learning_rate_at(self, step: int) -> float:
        """Linear warm-up in a tenth of the steps, then cosine to zero."""
        return warmed_cosine(self.learning_rate, step, self.num_steps, max(1, self.num_steps // 10))


@dataclass(frozen=True)
class CodedScene:
    """A scene, what is known of its depth, and its coded latents of one stage or two with their lambdas."""

    batch: Batch
    matched: MatchedDisparity
    lambdas_q: tuple[int, ...]
    y_hat: tuple[Float[Tensor, "view latent h8 w8"], ...]


def train_receiver(trainer: Trainer, phase: ReceiverPhase) -> Iterator[dict[str, float]]:
    """Train g_s, U and P of a trainer's averaged weights, then save its checkpoint with their new average.

    Yields step, steps skipped for gradients that were not finite, and the parts of the loss in the mean of `LOG_EVERY`
    steps. Stopped before its end it leaves the checkpoint as it was.
    """
    trainer.networks.load_state_dict(trainer.average)
    averaged = copy.deepcopy(trainer.receiver)
    learning = _float_networks(trainer.receiver)
    average: list[Tensor] = list(_float_networks(averaged).parameters())
    optimiser = torch.optim.AdamW(learning.parameters(), lr=1.0, betas=(0.9, 0.99), weight_decay=1e-4, fused=True)
    # Every process takes the same shapes, and codes when the others do, so that none waits.
    common = torch.Generator().manual_seed(trainer.generator.initial_seed() // 1000)
    own = random.Random(trainer.generator.initial_seed())
    coded: dict[BatchShape, list[CodedScene]] = {}
    window: list[dict[str, float]] = []
    num_skipped = 0
    for step in range(phase.num_steps):
        optimiser.zero_grad(set_to_none=True)
        for _ in range(phase.scenes_of_a_step):
            shape = trainer.settings.configuration.shapes.draw(common)
            scenes = coded.setdefault(shape, [])
            is_fresh = bool(torch.rand((), generator=common) < phase.fresh_share)
            if is_fresh or len(scenes) < phase.least_scenes * LAMBDAS_OF_A_SCENE:
                scenes += code_scene(trainer, averaged, shape)
                scene = scenes[-1]
            else:
                scene = own.choice(scenes)
            loss, parts = loss_of_scene(trainer.receiver, scene)
            (loss / phase.scenes_of_a_step).backward()
            window.append(parts)
        if math.isfinite(follow_gradients(optimiser, learning, phase.learning_rate_at(step))):
            decay = min(AVERAGE_DECAY, (1 + step) / (10 + step))
            with torch.no_grad():
                torch._foreach_lerp_(average, list(learning.parameters()), 1.0 - decay)
        else:
            num_skipped += 1
        if (step + 1) % LOG_EVERY == 0 or step + 1 == phase.num_steps:
            yield {"step": float(step + 1), "skipped": float(num_skipped)} | mean_of_rows(window)
            window = []
    trainer.receiver.load_state_dict(averaged.state_dict())
    trainer.average = {name: value.detach().clone() for name, value in trainer.networks.state_dict().items()}
    trainer.save(trainer.checkpoint)


@torch.no_grad()
def code_scene(trainer: Trainer, receiver: Receiver, shape: BatchShape) -> list[CodedScene]:
    """One scene of the trainer's sources as senders code it at some values of lambda, log-uniform; now and then in one
    stage, as in training."""
    configuration, generator = trainer.settings.configuration, trainer.generator
    share = configuration.schedule.photograph_share[1]
    lowest, highest = configuration.lambda_q_range
    one = BatchShape(1, shape.num_context, shape.num_target, shape.size)
    batch = draw_batch(trainer.sources, generator, one, share)
    context = list(range(shape.num_context))
    packed = pack(batch.cameras.scene(0).select(context))
    batch = batch.to(trainer.settings.device)
    scene = PreparedScene(packed, batch.cameras.scene(0).select(context), batch.images[0, context], shape.size)
    profile = Profile(trainer.sender, receiver, model_id=b"")
    found = match_views(profile, scene)
    settled = found.depth.relative_disparity[None, :, 0]
    matched = MatchedDisparity(settled, settled, found.depth.agreement[None, :, 0])
    matched = with_targets(trainer.sender, batch, matched)
    result = []
    for lambda_q in torch.randint(lowest, highest + 1, (LAMBDAS_OF_A_SCENE,), generator=generator).tolist():
        num_stages = 1 if int(torch.randint(ALONE_EVERY, (), generator=generator)) == 0 else 2
        stages = code_stages(profile, scene, found, lambda_q, num_stages)
        lambdas_q, y_hat = tuple(s.lambda_q for s in stages), tuple(s.latents.y_hat for s in stages)
        result.append(CodedScene(batch, matched, lambdas_q, y_hat))
    return result


def _float_networks(receiver: Receiver) -> nn.ModuleList:
    """What this phase trains: neither the entropy model, nor what the sender's networks know too."""
    return nn.ModuleList((receiver.synthesis, receiver.update.join, receiver.update.block, receiver.predictor))


def loss_of_scene(receiver: Receiver, scene: CodedScene) -> tuple[Float[Tensor, ""], dict[str, float]]:
    """That of the last stage, as in the schedule; nothing is coded, so there is no rate in it."""
    batch, views = scene.batch, tuple(range(scene.batch.num_context))
    states: ViewStates | None = None
    for stage, (lambda_q, y_hat) in enumerate(zip(scene.lambdas_q, scene.y_hat, strict=True), start=1):
        lambdas = torch.full((len(views),), lambda_q, device=y_hat.device)
        states = update_views(receiver, states, y_hat, lambdas, stage, views)
    assert states is not None  # a scene has a stage
    prediction = receiver.predict(states.state, batch.cameras.select(list(views)), states.condition)
    size = (batch.images.shape[-2], batch.images.shape[-1])
    rendering = render(prediction.gaussians.scene(0), batch.cameras.scene(0), size)
    no_bits = torch.zeros(1, device=batch.images.device)
    last_lambda_q = torch.tensor(scene.lambdas_q[-1:], device=batch.images.device)
    outcome = StageOutcome(prediction, [rendering], no_bits, last_lambda_q)
    loss, parts = loss_of(batch, [outcome], scene.matched, DISPARITY_WEIGHT)
    return loss, {name.removesuffix("1"): parts[name] for name in ("mse1", "mse_context1", "disparity1")}
