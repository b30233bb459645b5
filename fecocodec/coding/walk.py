"""The one walk through a latent, in the order of the bitstream: hyper-latent, then the quadtree's steps, the first of
them in three passes."""

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

FACTOR_32 = 4  # positions of y per position of z, along each side

Exchange = Callable[[int, EntropyParameters], Tensor]
"""(partition, parameters) -> values of that partition as the receiver will see them, Q8.

Partition 0 is z, [item height/32 width/32 channel]; then come the passes and steps of y, [4 item row column quarter].
"""


@dataclass(frozen=True)
class WalkedLatents:
    """Values as the receiver will see them, Q8: multiples of 1 in floats."""

    z_hat_q8: Float[Tensor, "item hyper height_32 width_32"]
    y_hat_q8: Float[Tensor, "item latent height_8 width_8"]


def split_partitions(
    y: Float[Tensor, "item latent height_8 width_8"], z: Float[Tensor, "item hyper _ _"]
) -> list[Tensor]:
    """Latents in the layout of each partition."""
    first, *others = to_coding_order(y)
    return [z.permute(0, 2, 3, 1), *split_passes(first), *others]


def in_layout(of_item: Float[Tensor, " item"], partition: int) -> Float[Tensor, "*broadcast"]:
    """One value an item, to be broadcast against that partition's layout."""
    return of_item.view(-1, 1, 1, 1) if partition == 0 else of_item.view(1, -1, 1, 1, 1)


def walk_latents(
    prior: LatentPrior,
    condition_q8: Float[Tensor, "item 4"],
    size_32: tuple[int, int],
    context_q8: Float[Tensor, "item latent height_8 width_8"] | None,
    exchange: Exchange,
) -> WalkedLatents:
    """Calls `exchange` for each partition with what the partitions before it tell.

    condition_q8: see `condition_vector`; its dtype is that of all arithmetic (float64 when coding). size_32: height and
    width of z. context_q8: y_hat of the stage before, or None.
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
        return WalkedLatents(z_hat_q8.permute(0, 3, 1, 2), from_coding_order(torch.stack(steps)))
