"""Ablations by retraining: every variant goes on from one checkpoint for the same few steps, then codes the dev pairs.

    python benchmarks/ablate_training.py LAST.pt PHOTOGRAPHS TEXTURES ROOT INDEX.json [--steps 24]

Training: one scene a step, two context and two target views of 128x128, at the one lambda that is measured; averaged
weights and AdamW's moments from the checkpoint, learning rate falling linearly to 0. All variants of a seed see the
same batches and the same noise, but for the two that change where scenes come from. Rows: means over two-view entries
of real streams, decoded; differences are to "as it is" trained for as many steps, with the standard error over entries.

A short continuation says how much networks that grew up with a part need it, or how fast a new part begins to pay, not
what networks trained without it, or with it, from the start would reach. The extractor's size cannot be asked this way.
How much chance decides is what the rows of other seeds show. "d loss" is on the batches of the last half of the steps,
rate and rendering of both stages, in percent.
"""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any

import torch
from ablation_measures import HEADER, Measured, measure, read_entries, row
from ablation_variants import (
    attend_twice,
    colour_by_direction,
    compare_features,
    drop_attention,
    drop_prior_context,
    feed_back_difference_alone,
    feed_back_photograph_alone,
    feed_back_rendering,
    gaussians_at_full,
    gaussians_at_quarter,
    halve_neighbours,
)
from torch import nn

from fecocodec.config import ReceiverConfig, SenderConfig
from fecocodec.container import quantise_lambda
from fecocodec.layers.memory_format import to_channels_last
from fecocodec.receiver.model import Receiver
from fecocodec.sender.encode import Profile
from fecocodec.sender.model import Sender
from fecocodec.training.batch_shapes import BatchShape, BatchShapes
from fecocodec.training.checkpoint import load_checkpoint
from fecocodec.training.configurations import Configuration
from fecocodec.training.dataset import Sources, draw_batch
from fecocodec.training.objective import Batch, code_with_noise, loss_of, run_stages
from fecocodec.training.schedule import Schedule
from fecocodec.training.sources import open_sources

SIZE = (128, 128)
SHAPE = BatchShape(num_scenes=1, num_context=2, num_target=2, size=SIZE)
LARGEST_GRADIENT = 1.0
AS_IT_IS = "as it is"


def _leave(sender: Sender, receiver: Receiver) -> None:
    """Change nothing."""


@dataclass(frozen=True)
class Variant:
    """What differs from "as it is": the networks, the data, the loss, or chance alone."""

    change: Callable[[Sender, Receiver], None] = _leave
    photograph_share: float = 0.5
    disparity_weight: float = 0.5
    seed: int = 0
    num_stages: int = 2
    is_trained: bool = True


VARIANTS = {  # the most telling first
    AS_IT_IS: Variant(),
    "the checkpoint, not trained on": Variant(is_trained=False),
    "as it is, seed 1": Variant(seed=1),
    "stage-2 prior without y1_hat": Variant(drop_prior_context),
    "no KNN attention": Variant(drop_attention),
    "E_fb: photograph alone": Variant(feed_back_photograph_alone),
    "E_fb: and error of CNN features": Variant(compare_features),
    "Gaussians at 1/4": Variant(gaussians_at_quarter),
    "Gaussians at 1/1": Variant(gaussians_at_full),
    "three stages": Variant(num_stages=3),
    "three stages, not trained on": Variant(num_stages=3, is_trained=False),
    "no depth supervision": Variant(disparity_weight=0.0),
    "procedural scenes only": Variant(photograph_share=0.0),
    "photographs only": Variant(photograph_share=1.0),
    "SH degree 1": Variant(colour_by_direction),
    "8 neighbours": Variant(halve_neighbours),
    "E_fb: photograph and rendering": Variant(feed_back_rendering),
    "two KNN attention blocks": Variant(attend_twice),
    "E_fb: difference alone": Variant(feed_back_difference_alone),
    "as it is, seed 2": Variant(seed=2),
}


def train(
    variant: Variant, saved: dict[str, Any], batches: Iterator[Batch], steps: int, peak: float
) -> tuple[Profile, list[float]]:
    """The networks of a variant after so many steps from the checkpoint, ready to code, and each step's loss; depth is
    trained for but not part of the loss returned.
    """
    receiver = Receiver(ReceiverConfig())
    sender = Sender(SenderConfig(), receiver.config)
    networks = nn.ModuleDict({"receiver": receiver, "sender": sender})
    networks.load_state_dict(saved["average"])
    to_channels_last(networks, "cpu")
    optimiser = torch.optim.AdamW(networks.parameters(), lr=peak, betas=(0.9, 0.99), weight_decay=1e-4, fused=True)
    optimiser.load_state_dict(saved["optimiser"])
    torch.manual_seed(variant.seed)  # of new parts, then of the noise that stands for rounding
    known = set(networks.parameters())
    variant.change(sender, receiver)
    new = [parameter for parameter in networks.parameters() if parameter not in known]
    if new:
        optimiser.add_param_group({"params": new})
    torch.manual_seed(variant.seed)
    losses = []
    for step in range(steps if variant.is_trained else 0):
        for group in optimiser.param_groups:
            group["lr"] = peak * (1.0 - step / steps)
        batch = next(batches)
        outcomes, matched = run_stages(sender, receiver, batch, code_with_noise(receiver, sender), variant.num_stages)
        loss, _ = loss_of(batch, outcomes, matched, variant.disparity_weight)
        with torch.no_grad():
            losses.append(float(loss_of(batch, outcomes, matched, disparity_weight=0.0)[0]))
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(networks.parameters(), LARGEST_GRADIENT, error_if_nonfinite=True)
        optimiser.step()
    networks.eval().requires_grad_(False)
    return Profile(sender, receiver, bytes(8)), losses


def draw_batches(sources: Sources, variant: Variant, lambda_q: int) -> Iterator[Batch]:
    """Batches without end; the generator of each is seeded apart, so that sources do not shift what comes after."""
    step = 0
    while True:
        generator = torch.Generator().manual_seed(variant.seed * 1_000_003 + step)
        yield draw_batch(sources, generator, SHAPE, variant.photograph_share, (lambda_q, lambda_q))
        step += 1


def main() -> None:
    """Print one line per variant as soon as it is measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("checkpoint", "photographs", "textures", "root", "index"):
        parser.add_argument(name, type=Path)
    parser.add_argument("--steps", type=int, default=24)
    parser.add_argument("--entries", type=int, default=31)
    parser.add_argument("--size", type=int, default=128, help="of the dev pairs")
    parser.add_argument("--lambda", dest="lmbda", type=float, default=1e-3)
    parser.add_argument("--learning-rate", type=float, default=2e-4, help="of the first step")
    parser.add_argument("--only", nargs="+", choices=VARIANTS, default=[*VARIANTS])
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    shapes = BatchShapes(SHAPE.num_scenes, ((SHAPE.num_context, 1.0),), SHAPE.num_target, (SIZE,))
    configuration = Configuration(shapes, Schedule(num_steps=1))
    sources = open_sources(arguments.photographs, arguments.textures, configuration)
    entries = read_entries(arguments.root, arguments.index, arguments.entries, (arguments.size, arguments.size))
    saved, lambda_q = load_checkpoint(arguments.checkpoint), quantise_lambda(arguments.lmbda)
    print("\t".join((*HEADER, "CPU s")), flush=True)
    reference: Measured | None = None
    for name in (AS_IT_IS, *(name for name in arguments.only if name != AS_IT_IS)):
        start, variant = process_time(), VARIANTS[name]
        batches = draw_batches(sources, variant, lambda_q)
        profile, losses = train(variant, saved, batches, arguments.steps, arguments.learning_rate)
        found = Measured(
            entries=[measure(profile, entry, lambda_q, variant.num_stages) for entry in entries],
            losses=losses[arguments.steps // 2 :],
            batches=(variant.photograph_share, variant.seed, variant.is_trained and variant.num_stages == 2),
        )
        reference = reference or found
        print(f"{row(name, found, reference)}\t{process_time() - start:.0f}", flush=True)


if __name__ == "__main__":
    main()
