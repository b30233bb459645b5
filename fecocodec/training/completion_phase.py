"""A phase of training before the schedule: depth completion alone, against disparity that more views confirm.

It needs neither the codec nor a renderer, so a step takes less than a second, and its scenes are kept in memory.
"""

import math
import random
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.errors import InputError
from fecocodec.sender.extractors.compact import CompactExtractor
from fecocodec.sender.extractors.depth_completion import DepthCompletion
from fecocodec.training.batch_shapes import BatchShape
from fecocodec.training.completion_scenes import NUM_CONTEXT, NUM_FURTHER, CompletionScene, completion_scene, varied
from fecocodec.training.dataset import draw_sample
from fecocodec.training.log import mean_of_rows
from fecocodec.training.optimisation import clipped_step, cosine_with_warm_up
from fecocodec.training.trainer import Trainer

SIZES = ((256, 256), (256, 256), (192, 320), (320, 192), (224, 288))  # (height, width) in pixels
SCENES_OF_A_STEP = 4
LEAST_WEIGHT = 0.1  # of the error of confirmed pixels; that of unconfirmed ones has the weight 1
PRIOR_PIXELS = 50.0  # added to the weight of a view, so that views with few known pixels count less
DIFFERENCE_WEIGHT = 0.5  # of the error of differences between neighbouring pixels
UNCONFIRMED = 0.5  # consistency, for the log
AVERAGE_DECAY = 0.998
WARM_UP, LOG_EVERY = 100, 200  # steps


@dataclass(frozen=True)
class CompletionPhase:
    """Settings of the phase. num_scenes: per process, kept in memory (1.5 MB each). sizes: (height, width)."""

    num_steps: int
    num_scenes: int = 500
    learning_rate: float = 1e-3
    sizes: tuple[tuple[int, int], ...] = SIZES

    def learning_rate_at(self, step: int) -> float:
        """Linear warm-up, then cosine to zero."""
        return cosine_with_warm_up(self.learning_rate, step, self.num_steps, WARM_UP)


def train_completion(trainer: Trainer, phase: CompletionPhase) -> Iterator[dict[str, float]]:
    """Train depth completion alone; the trainer goes on with its averaged weights.

    Every `LOG_EVERY` steps, yields the step, the loss, and the mean error of unconfirmed relative disparity after and
    before completion. Raises InputError for a sender without depth completion.
    """
    completion = _completion_of(trainer)
    scenes = list(draw_scenes(trainer, phase))
    rng = random.Random(trainer.generator.initial_seed())
    average = {name: value.clone() for name, value in completion.state_dict().items()}
    optimiser = torch.optim.AdamW(completion.parameters(), lr=1.0, betas=(0.9, 0.99), weight_decay=1e-2)
    window: list[dict[str, float]] = []
    for step in range(phase.num_steps):
        optimiser.zero_grad(set_to_none=True)
        for scene in rng.choices(scenes, k=SCENES_OF_A_STEP):
            loss, parts = completion_loss(completion, varied(scene, rng))
            (loss / SCENES_OF_A_STEP).backward()
            window.append(parts)
        if math.isfinite(clipped_step(optimiser, completion, phase.learning_rate_at(step))):
            decay = min(AVERAGE_DECAY, (1 + step) / (10 + step))
            torch._foreach_lerp_(list(average.values()), list(completion.state_dict().values()), 1.0 - decay)
        if (step + 1) % LOG_EVERY == 0 or step + 1 == phase.num_steps:
            yield {"step": float(step + 1)} | mean_of_rows(window)
            window = []
    completion.load_state_dict(average)
    trainer.begin_average()


def draw_scenes(trainer: Trainer, phase: CompletionPhase) -> Iterator[CompletionScene]:
    """Draw and match the scenes of the phase from the trainer's sources."""
    share = trainer.settings.configuration.schedule.photograph_share[1]
    for number in range(phase.num_scenes):
        shape = BatchShape(1, NUM_CONTEXT, NUM_FURTHER, phase.sizes[number % len(phase.sizes)])
        yield completion_scene(trainer.sender.extractor, draw_sample(trainer.sources, trainer.generator, shape, share))


def completion_loss(completion: DepthCompletion, scene: CompletionScene) -> tuple[Float[Tensor, ""], dict[str, float]]:
    """Return the loss, L1 on disparity and on its differences between neighbours, and numbers for the log."""
    found = completion(scene.maps, scene.photographs, scene.features.float())
    known, error = scene.is_known.float(), found - scene.truth
    weight = known * (1.0 - scene.maps.consistency + LEAST_WEIGHT)
    views = (1, 2, 3)
    loss = ((weight * error.abs()).sum(dim=views) / (weight.sum(dim=views) + PRIOR_PIXELS)).mean()
    for axis in (2, 3):
        both = known.narrow(axis, 1, known.shape[axis] - 1) * known.narrow(axis, 0, known.shape[axis] - 1)
        loss = loss + DIFFERENCE_WEIGHT * (both * error.diff(dim=axis).abs()).mean()
    with torch.no_grad():
        unconfirmed = known * (scene.maps.consistency < UNCONFIRMED)
        before = (scene.maps.blended - scene.truth).abs()
        errors = [float((unconfirmed * x).sum() / (unconfirmed.sum() + 1.0)) for x in (error.abs(), before)]
    return loss, {"loss": float(loss.detach()), "error": errors[0], "error_before": errors[1]}


def _completion_of(trainer: Trainer) -> DepthCompletion:
    extractor = trainer.sender.extractor
    if not isinstance(extractor, CompactExtractor) or extractor.completion is None:
        raise InputError("This sender has no depth completion to train; choose the configuration compact-monocular.")
    return extractor.completion
