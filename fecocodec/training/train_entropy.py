"""Train the entropy model of a finished model alone, on latents of its other networks.

A step of the entropy model takes a tenth of a second instead of seconds, so that it can be trained for many more steps.
The other networks do not change. Because the choice of symbols depends on their bits, files at a fixed lambda change in
size and in quality; at equal quality they are smaller.
"""

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.coding.rate import estimate_latents, rounding, uniform_noise
from fecocodec.errors import InputError
from fecocodec.geometry.views import Views
from fecocodec.sender.codec import Codec
from fecocodec.sender.encode import write_stages
from fecocodec.sender.lambda_roles import stage_lambdas
from fecocodec.sender.optimisation_config import DEFAULT
from fecocodec.sender.scene import prepare_scene
from fecocodec.sender.scene_encoder import SceneEncoder
from fecocodec.training.configurations import Configuration, configuration_named
from fecocodec.training.loop import train_alone
from fecocodec.training.loss import lambda_of
from fecocodec.training.optimisation import OptimiserConfig, Schedule
from fecocodec.training.processes import seeded_generator
from fecocodec.training.sources import Sources, draw_sample

ENTROPY = replace(
    configuration_named("compact"),
    schedule=Schedule(12_000, learning_rate=2e-3, warm_up=100),
    optimiser=OptimiserConfig(average_decay=0.0),
)
LAMBDAS_OF_A_SCENE = 2  # matching, the slowest part, is shared by them
LOG_EVERY = 200  # steps


@dataclass(frozen=True)
class SceneLatents:
    """Latents of one or two stages before coding, and y_hat of stage 1 for stage 2. lambda_q: as in streams."""

    lambda_q: int
    y: tuple[Float[Tensor, "view latent h8 w8"], ...]
    y1_hat: Float[Tensor, "view latent h8 w8"] | None = None


def train_entropy_model(
    codec: Codec, sources: Sources, configuration: Configuration = ENTROPY, seed: int = 0, num_scenes: int = 400
) -> Iterator[dict[str, float]]:
    """Train the prior and h_a of a codec, in place.

    configuration: of the steps, the optimiser and the scenes. num_scenes: per process; their latents are kept in
    memory, about 1.6 MB per pair of 256x256 pixels. Yields what `train_alone` does, with the bits per context pixel of
    each stage. Raises InputError for a codec of the paper's method.
    """
    if not codec.receiver.config.kind.has_steps:
        raise InputError("This model has the paper's method, which trains all networks together; train it as a whole.")
    generator = seeded_generator(seed)
    scenes = draw_latents(codec, sources, configuration, generator, num_scenes)
    order = random.Random(generator.initial_seed())

    def add_gradients() -> dict[str, float]:
        loss, row = _priced_bits(codec, order.choices(scenes)[0])
        loss.backward()
        return row

    learning = nn.ModuleList((codec.receiver.prior, codec.sender.hyper_analysis))
    yield from train_alone(codec, learning, configuration, add_gradients, LOG_EVERY)


def draw_latents(
    codec: Codec, sources: Sources, configuration: Configuration, generator: torch.Generator, num_scenes: int
) -> list[SceneLatents]:
    """Return latents of scenes drawn from the sources, each coded at `LAMBDAS_OF_A_SCENE` log-uniform values of lambda.

    At the last of them, every `alone_every`-th scene of the configuration has a single stage, as in training.
    """
    share = configuration.schedule.photograph_share[1]
    lowest, highest = configuration.lambda_q_range
    found: list[SceneLatents] = []
    for number in range(1, num_scenes + 1):
        sample = draw_sample(sources, generator, configuration.shapes.draw(generator), share)
        drawn = torch.randint(lowest, highest + 1, (LAMBDAS_OF_A_SCENE,), generator=generator)
        context = sample.views.select(list(range(sample.num_context)))
        num_alone = 1 if number % configuration.alone_every == 0 else 0
        found += latents_of(codec, context, drawn.tolist(), num_alone)
    return found


@torch.no_grad()
def latents_of(codec: Codec, views: Views, lambdas_q: Sequence[int], num_alone: int = 0) -> list[SceneLatents]:
    """Return the latents that the sender codes for these views; a single stage at the last `num_alone` lambdas."""
    scene = prepare_scene(views, codec.device)
    encoder = SceneEncoder.of(codec, scene)
    found = []
    for position, lambda_q in enumerate(lambdas_q):
        num_stages = 2 if position < len(lambdas_q) - num_alone else 1
        stages = write_stages(encoder, lambda_q, num_stages, DEFAULT)
        y1_hat = stages[0].coded.y_hat if num_stages == 2 else None
        found.append(SceneLatents(lambda_q, tuple(stage.y for stage in stages), y1_hat))
    return found


def _priced_bits(codec: Codec, scene: SceneLatents) -> tuple[Float[Tensor, ""], dict[str, float]]:
    """Return the loss, bits per context pixel times sqrt(lambda / 1e-3), and the bits per context pixel of each stage.

    The weight compensates for the decrease of bits with lambda.
    """
    prior, hyper_analysis = codec.receiver.prior, codec.sender.hyper_analysis
    lambda_q = torch.full((len(scene.y[0]),), scene.lambda_q, device=scene.y[0].device)
    pixels = 64 * scene.y[0][:, 0].numel()
    bits: dict[str, Tensor] = {}
    for stage, (y, lambdas) in enumerate(zip(scene.y, stage_lambdas(lambda_q, len(scene.y)), strict=True), start=1):
        context = None if stage == 1 else scene.y1_hat
        estimate = estimate_latents(prior, y, hyper_analysis(y), lambdas, stage, context, rounding(uniform_noise()))
        bits[f"bpp{stage}"] = (estimate.bits_y + estimate.bits_z).sum() / pixels
    weight = (lambda_of(lambda_q) / 1e-3).sqrt().mean()  # it is the same for all views
    row = {name: float(value.detach()) for name, value in bits.items()}
    return weight * torch.stack(list(bits.values())).sum(), row
