"""Train the network that proposes steps of latent optimisation alone, on scenes that are encoded as in use."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from fecocodec.errors import InputError
from fecocodec.sender.codec import Codec
from fecocodec.sender.fading import LEAST_VIEWS, fader
from fecocodec.sender.model import Sender
from fecocodec.sender.optimisation_config import DEFAULT
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.sender.stages import Improvements, estimate_bits
from fecocodec.training.batch import Batch
from fecocodec.training.configurations import Configuration, configuration_named
from fecocodec.training.loop import train_alone
from fecocodec.training.optimisation import OptimiserConfig, Schedule
from fecocodec.training.processes import seeded_generator
from fecocodec.training.sources import Sources, draw_batch
from fecocodec.training.step_learning import StepLearner

STEPS = replace(
    configuration_named("compact"),
    schedule=Schedule(350, learning_rate=1e-3, warm_up=30),
    optimiser=OptimiserConfig(average_decay=0.98),
)
LOG_EVERY = 25  # steps of the optimiser


def train_step_network(
    codec: Codec, sources: Sources, configuration: Configuration = STEPS, seed: int = 0
) -> Iterator[dict[str, float]]:
    """Train the step network of a codec, in place.

    configuration: of the steps of the optimiser, the scenes, and the weight of ST-LPIPS. Yields what `train_alone`
    does, with the change of the loss, of D of context and of target views, and of the logarithm of the bits by the
    steps of each stage. Raises InputError for a sender without this network.
    """
    network = codec.sender.steps
    if network is None:
        raise InputError("This model has no network that proposes steps; train one with the configuration compact.")
    generator = seeded_generator(seed)
    learner = StepLearner(network, DEFAULT, generator, configuration.perceptual_weight)

    def add_gradients() -> dict[str, float]:
        return learn_from_scene(codec, _draw(codec, sources, configuration, generator), learner)

    yield from train_alone(codec, network, configuration, add_gradients, LOG_EVERY)


def learn_from_scene(codec: Codec, batch: Batch, learner: StepLearner) -> dict[str, float]:
    """Encode a batch of one scene, and add to the gradients of the network.

    Returns how the steps of each stage change the parts of the loss, see `train_step_network`.
    """
    context = list(range(batch.num_context))
    encoder = SceneEncoder(codec, batch.images[:, context], batch.cameras.select(context))
    changes: dict[str, float] = {}
    with torch.no_grad():
        optimise = learner.optimiser(encoder, batch, changes.update)
        fade = None
        if len(context) >= LEAST_VIEWS:  # as in encoding
            fade = fader(encoder.images[0], encoder.cameras.scene(0), encoder.background)
        encoder.run(batch.lambda_q, 2, estimate_bits(encoder.codec), Improvements(optimise, fade))
    return changes


def with_sharp_steps(codec: Codec, trained: Sequence[Mapping[str, Tensor]], is_between: bool) -> Codec:
    """Return the codec with a second step network, for sharper pictures: the mean of these states of a step network.

    is_between: the codec's own step network becomes the mean of itself and the new one. `encode --sharpness -1` then
    gives what 0 gave, and 0 what 0.5 gave.
    """
    sender = codec.sender
    sharp = {name: torch.stack([state[name] for state in trained]).mean(dim=0) for name in trained[0]}
    tensors = dict(sender.state_dict())
    if is_between:
        tensors |= {f"steps.{name}": (tensors[f"steps.{name}"] + value) / 2 for name, value in sharp.items()}
    grown = Sender(replace(sender.config, has_sharp_steps=True), codec.receiver.config)
    grown.load_state_dict(tensors | {f"sharp_steps.{name}": value for name, value in sharp.items()})
    return replace(codec, sender=grown)


def _draw(codec: Codec, sources: Sources, configuration: Configuration, generator: torch.Generator) -> Batch:
    """Draw a batch of one scene."""
    shape = replace(configuration.shapes.draw(generator), num_scenes=1)
    share = configuration.schedule.photograph_share[1]
    batch = draw_batch(sources, generator, shape, share, configuration.lambda_q_range)
    return batch.to(str(codec.device))
