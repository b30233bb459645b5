"""The order in which a latent is coded: four steps, each of them a quarter of the channels at every position.

Positions are split by parity into four phases m = 2 * (row odd) + (column odd), channels into four quarters. Step s
codes quarter `m XOR STEP_XOR[s]` at phase m (Li et al., "Neural video compression with diverse contexts", CVPR 2023):
after the first step every position has neighbours that know each quarter.
"""

from typing import Any

import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

NUM_STEPS = 4
NUM_PHASES = 4
STEP_XOR = (0, 3, 2, 1)  # its own inverse: quarter q is coded at phase m in step STEP_XOR[m XOR q]


def split_phases(x: Float[Tensor, "item height width channel"]) -> Float[Tensor, "4 item row column channel"]:
    """Positions by parity; a view. Height and width are even."""
    return rearrange(x, "item (row a) (column b) channel -> (a b) item row column channel", a=2, b=2)


def merge_phases(x: Float[Tensor, "4 item row column channel"]) -> Float[Tensor, "item height width channel"]:
    """The inverse of `split_phases`."""
    return rearrange(x, "(a b) item row column channel -> item (row a) (column b) channel", a=2, b=2)


def to_coding_order(y: Float[Tensor, "item channel height width"]) -> Float[Tensor, "4 4 item row column quarter"]:
    """Latent -> [step phase item row column channel-in-quarter], the order of the bitstream."""
    parts = rearrange(y, "n (q c) (i a) (j b) -> q (a b) n i j c", q=4, a=2, b=2)
    phase = torch.arange(NUM_PHASES, device=y.device)
    quarter = phase ^ torch.tensor(STEP_XOR, device=y.device)[:, None]
    return parts[quarter, phase]


def from_coding_order(
    coded: Float[Tensor, "4 4 item row column quarter"],
) -> Float[Tensor, "item channel height width"]:
    """The inverse of `to_coding_order`."""
    phase = torch.arange(NUM_PHASES, device=coded.device)
    step = torch.tensor(STEP_XOR, device=coded.device)[phase ^ phase[:, None]]
    return rearrange(coded[step, phase], "q (a b) n i j c -> n (q c) (i a) (j b)", a=2, b=2)


class _Neighbourhoods(torch.autograd.Function):
    """3x3 neighbourhoods; a function of its own because autograd's gradient of nine slices fills nine tensors."""

    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        height, width = x.shape[1:3]
        padded = torch.nn.functional.pad(x, (0, 0, 1, 1, 1, 1))
        return torch.cat([padded[:, i : i + height, j : j + width] for i in range(3) for j in range(3)], dim=-1)

    @staticmethod
    def backward(ctx: Any, grad: Tensor) -> Tensor:
        items, height, width, columns = grad.shape
        padded = grad.new_zeros(items, height + 2, width + 2, columns // 9)
        for offset, part in enumerate(grad.chunk(9, dim=-1)):
            i, j = divmod(offset, 3)
            padded[:, i : i + height, j : j + width] += part
        return padded[:, 1:-1, 1:-1]


def neighbourhoods(x: Float[Tensor, "item height width channel"]) -> Float[Tensor, "item height width columns"]:
    """3x3 surroundings of every position, 9 * channel columns (row offset, column offset, channel); zero outside."""
    result: Tensor = _Neighbourhoods.apply(x)
    return result
