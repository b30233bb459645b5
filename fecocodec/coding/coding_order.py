"""Scan of the latents of one stage in coding order, shared by writer, reader and rate estimate.

The order is: hyper-latent z, the three passes of the first step of y, its other three steps (see `quadtree`).
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.coding.priors import EntropyParameters, LatentPrior
from fecocodec.coding.quadtree import (
    NUM_PASSES,
    from_coding_order,
    merge_passes,
    split_passes,
    to_coding_order,
)

Exchange = Callable[[int, EntropyParameters], Tensor]
"""(partition, parameters) -> dequantised values of that partition, Q8.

Partition 0 is z, [item height/32 width/32 channel]; partitions 1 to 6 are the passes and steps of y, [4 item row column
quarter].
"""


@dataclass(frozen=True)
class DequantisedLatents:
    """Dequantised latents as Q8 integers, in floats."""

    z_hat_q8: Float[Tensor, "item hyper height_32 width_32"]
    y_hat_q8: Float[Tensor, "item latent height_8 width_8"]


def split_partitions(
    y: Float[Tensor, "item latent height_8 width_8"], z: Float[Tensor, "item hyper _ _"]
) -> list[Tensor]:
    """Split latents into the partitions of the coding order, each in its layout (see `Exchange`)."""
    first, *others = to_coding_order(y)
    return [z.permute(0, 2, 3, 1), *split_passes(first), *others]


def in_layout(of_item: Float[Tensor, " item"], partition: int) -> Float[Tensor, "*broadcast"]:
    """Reshape one value per item for broadcasting against the layout of a partition."""
    return of_item.view(-1, 1, 1, 1) if partition == 0 else of_item.view(1, -1, 1, 1, 1)


def scan_latents(
    prior: LatentPrior,
    condition_q8: Float[Tensor, "item 4"],
    size_32: tuple[int, int],
    context_q8: Float[Tensor, "item latent height_8 width_8"] | None,
    exchange: Exchange,
) -> DequantisedLatents:
    """Predict the entropy parameters of each partition from the earlier ones, and call `exchange` with them.

    condition_q8: see `condition_vector`; its dtype is that of all arithmetic (float64 when coding). size_32: height and
    width of z. context_q8: y_hat of stage 1 in stage 2, Q8; None in stage 1.
    """
    # Under autocast the layers would run in half precision.
    with torch.autocast(condition_q8.device.type, enabled=False):
        z_hat_q8 = exchange(0, prior.hyper_parameters(condition_q8, *size_32))
        context_q8 = None if context_q8 is None else context_q8.to(condition_q8.dtype).permute(0, 2, 3, 1)
        known = [prior.features(z_hat_q8, condition_q8, context_q8)]
        blocks: list[Tensor] = []
        for number in range(NUM_PASSES):
            blocks.append(exchange(1 + number, prior.block_parameters(known[0], blocks)))
        steps = [merge_passes(blocks)]
        for step, network in enumerate(prior.steps.values(), start=1):
            known.append(prior.surroundings(steps[-1]))
            steps.append(exchange(NUM_PASSES + step, network(known)))
        return DequantisedLatents(z_hat_q8.permute(0, 3, 1, 2), from_coding_order(torch.stack(steps)))
