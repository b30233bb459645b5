"""Last phase of training: the entropy model alone, on latents of the trained networks.

A step of the entropy model takes a tenth of a second instead of seconds, so that it can be trained for many more steps.
The other networks do not change. Because the choice of symbols depends on their bits, files at a fixed lambda change in
size and in quality; at equal quality they are smaller.
"""

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.coding.rate import estimate_latents, rounding, uniform_noise
from fecocodec.geometry.views import Views
from fecocodec.sender.codec import Codec
from fecocodec.sender.encode import write_stages
from fecocodec.sender.lambda_roles import stage_lambdas
from fecocodec.sender.optimisation_config import DEFAULT, OptimisationConfig
from fecocodec.sender.scene import prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.training.dataset import draw_sample
from fecocodec.training.log import mean_of_rows
from fecocodec.training.loss import lambda_of
from fecocodec.training.optimisation import clipped_step, cosine_with_warm_up
from fecocodec.training.trainer import Trainer

LAMBDAS_OF_A_SCENE = 2  # matching, the slowest part, is shared by them
SCENES_OF_A_STEP = 2
WARM_UP = 100  # steps
LOG_EVERY = 200  # steps


@dataclass(frozen=True)
class EntropyPhase:
    """Settings of the phase.

    num_scenes: scenes per process, whose latents are kept in memory (about 1.6 MB per pair of 256x256 pixels).
    optimisation: of the latents, as in encoding. alone_every: the last of so many scenes has one stage, as in training.
    """

    num_steps: int
    num_scenes: int = 400
    learning_rate: float = 2e-3
    optimisation: OptimisationConfig = DEFAULT
    alone_every: int = 8

    def learning_rate_at(self, step: int) -> float:
        """Linear warm-up, then cosine to zero."""
        return cosine_with_warm_up(self.learning_rate, step, self.num_steps, WARM_UP)


@dataclass(frozen=True)
class SceneLatents:
    """Latents of one or two stages before coding, and y_hat of stage 1 for stage 2. lambda_q: as in streams."""

    lambda_q: int
    y: tuple[Float[Tensor, "view latent h8 w8"], ...]
    y1_hat: Float[Tensor, "view latent h8 w8"] | None = None


def train_entropy_model(trainer: Trainer, phase: EntropyPhase) -> Iterator[dict[str, float]]:
    """Train entropy model and hyper-analysis, starting at a trainer's averaged weights, then save its checkpoint.

    Every `LOG_EVERY` steps, yields the step, the number of steps skipped because gradients were not finite, and the
    mean bits per context pixel of each stage. The checkpoint is written only at the end.
    """
    trainer.networks.load_state_dict(trainer.average)
    scenes = draw_latents(trainer, phase)
    learning = nn.ModuleList((trainer.receiver.prior, trainer.sender.hyper_analysis))
    optimiser = torch.optim.AdamW(learning.parameters(), lr=1.0, betas=(0.9, 0.99), weight_decay=1e-4, fused=True)
    order = random.Random(trainer.generator.initial_seed())
    window: list[dict[str, float]] = []
    num_skipped = 0
    for step in range(phase.num_steps):
        optimiser.zero_grad(set_to_none=True)
        for scene in order.choices(scenes, k=SCENES_OF_A_STEP):
            loss, parts = _priced_bits(trainer, scene)
            loss.backward()
            window.append(parts)
        num_skipped += not math.isfinite(clipped_step(optimiser, learning, phase.learning_rate_at(step)))
        if (step + 1) % LOG_EVERY == 0 or step + 1 == phase.num_steps:
            yield {"step": float(step + 1), "skipped": float(num_skipped)} | mean_of_rows(window)
            window = []
    trainer.average = {name: value.detach().clone() for name, value in trainer.networks.state_dict().items()}
    trainer.save(trainer.checkpoint)


def draw_latents(trainer: Trainer, phase: EntropyPhase) -> list[SceneLatents]:
    """Return latents of `phase.num_scenes` scenes drawn from the trainer's sources and shapes.

    Each scene is coded at `LAMBDAS_OF_A_SCENE` log-uniform values of lambda; every `phase.alone_every`-th scene has a
    single stage at the last of them, as in training.
    """
    configuration, generator = trainer.settings.configuration, trainer.generator
    share = configuration.schedule.photograph_share[1]
    lowest, highest = configuration.lambda_q_range
    codec = Codec(trainer.sender, trainer.receiver, model_id=b"")
    found: list[SceneLatents] = []
    for number in range(1, phase.num_scenes + 1):
        shape = configuration.shapes.draw(generator)
        sample = draw_sample(trainer.sources, generator, shape, share)
        drawn = torch.randint(lowest, highest + 1, (LAMBDAS_OF_A_SCENE,), generator=generator)
        context = sample.views.select(list(range(sample.num_context)))
        num_alone = 1 if number % phase.alone_every == 0 else 0
        found += latents_of(codec, context, drawn.tolist(), num_alone, phase.optimisation)
    return found


@torch.no_grad()
def latents_of(
    codec: Codec,
    views: Views,
    lambdas_q: Sequence[int],
    num_alone: int = 0,
    optimisation: OptimisationConfig = DEFAULT,
) -> list[SceneLatents]:
    """Return the latents that the sender codes for these views; a single stage at the last `num_alone` lambdas."""
    scene = prepare_scene(views, codec.device)
    encoder = SceneEncoder.of(codec, scene)
    found = []
    for position, lambda_q in enumerate(lambdas_q):
        num_stages = 2 if position < len(lambdas_q) - num_alone else 1
        stages = write_stages(encoder, lambda_q, num_stages, optimisation)
        y1_hat = stages[0].coded.y_hat if num_stages == 2 else None
        found.append(SceneLatents(lambda_q, tuple(stage.y for stage in stages), y1_hat))
    return found


def _priced_bits(trainer: Trainer, scene: SceneLatents) -> tuple[Float[Tensor, ""], dict[str, float]]:
    """Return the loss, bits per context pixel times sqrt(lambda / 1e-3), and the bits per context pixel of each stage.

    The weight compensates for the decrease of bits with lambda.
    """
    prior, hyper_analysis = trainer.receiver.prior, trainer.sender.hyper_analysis
    lambda_q = torch.full((len(scene.y[0]),), scene.lambda_q, device=scene.y[0].device)
    pixels = 64 * scene.y[0][:, 0].numel()
    bits: dict[str, Tensor] = {}
    for stage, (y, lambdas) in enumerate(zip(scene.y, stage_lambdas(lambda_q, len(scene.y)), strict=True), start=1):
        context = None if stage == 1 else scene.y1_hat
        estimate = estimate_latents(prior, y, hyper_analysis(y), lambdas, stage, context, rounding(uniform_noise()))
        bits[f"bpp{stage}"] = (estimate.bits_y + estimate.bits_z).sum() / pixels
    weight = (lambda_of(lambda_q) / 1e-3).sqrt().mean()  # it is the same for all views
    parts = {name: float(value.detach()) for name, value in bits.items()}
    return weight * torch.stack(list(bits.values())).sum(), parts
