"""Last phase of training: the network that proposes steps of latent optimisation, alone.

Scenes are encoded with latent optimisation; `step_learning` adds to the gradients.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import torch

from fecocodec.errors import InputError
from fecocodec.sender.codec import Codec
from fecocodec.sender.fading import LEAST_VIEWS, fader
from fecocodec.sender.latent_coding import estimate_bits
from fecocodec.sender.optimisation_config import DEFAULT, OptimisationConfig
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.stages import Improvements
from fecocodec.training.batch import Batch
from fecocodec.training.dataset import draw_batch
from fecocodec.training.log import mean_of_rows
from fecocodec.training.optimisation import clipped_step, cosine_with_warm_up
from fecocodec.training.step_learning import StepLearner
from fecocodec.training.trainer import Trainer

SCENES_OF_A_STEP = 2
AVERAGE_DECAY = 0.98
WARM_UP, LOG_EVERY = 30, 25  # updates


@dataclass(frozen=True)
class StepPhase:
    """Settings of the phase. num_updates: steps of the optimiser, each of two scenes a process."""

    num_updates: int
    learning_rate: float = 1e-3
    optimisation: OptimisationConfig = DEFAULT

    def learning_rate_at(self, update: int) -> float:
        """Linear warm-up, then cosine to zero."""
        return cosine_with_warm_up(self.learning_rate, update, self.num_updates, WARM_UP)


def train_step_network(trainer: Trainer, phase: StepPhase) -> Iterator[dict[str, float]]:
    """Train the step network, starting at a trainer's averaged weights, then save its checkpoint.

    Every `LOG_EVERY` updates, yields the number of updates, the number skipped because gradients were not finite, and
    how the steps of each stage change the loss, D of context and of target views, and the logarithm of the bits. The
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
    perceptual_weight = trainer.settings.configuration.perceptual_weight
    learner = StepLearner(network, phase.optimisation, trainer.generator, perceptual_weight)
    window: list[dict[str, float]] = []
    num_skipped = 0
    for update in range(phase.num_updates):
        optimiser.zero_grad(set_to_none=True)
        for _ in range(SCENES_OF_A_STEP):
            window.append(learn_from_scene(trainer, learner))
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


def learn_from_scene(trainer: Trainer, learner: StepLearner) -> dict[str, float]:
    """Draw a scene, encode it, and add to the gradients of the network.

    Returns how the steps of each stage change the parts of the loss, see `train_step_network`.
    """
    batch = _draw(trainer)
    context = list(range(batch.num_context))
    encoder = SceneEncoder(
        Codec(trainer.sender, trainer.receiver, b""), batch.images[:, context], batch.cameras.select(context)
    )
    changes: dict[str, float] = {}
    with torch.no_grad():
        optimise = learner.optimiser(encoder, batch, changes.update)
        fade = None
        if len(context) >= LEAST_VIEWS:  # as in encoding
            fade = fader(encoder.images[0], encoder.cameras.scene(0), encoder.background)
        encoder.run(batch.lambda_q, 2, estimate_bits(encoder.codec), Improvements(optimise, fade))
    return changes


def _draw(trainer: Trainer) -> Batch:
    """Draw a batch of one scene."""
    configuration = trainer.settings.configuration
    shape = replace(configuration.shapes.draw(trainer.generator), num_scenes=1)
    share = configuration.schedule.photograph_share[1]
    batch = draw_batch(trainer.sources, trainer.generator, shape, share, configuration.lambda_q_range)
    return batch.to(trainer.settings.device)
