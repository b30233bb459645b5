"""Coding order of a latent: four steps, each of which codes a quarter of the channels at every position.

Positions are split by parity into four phases m = 2 * (row odd) + (column odd), channels into four quarters. Step s
codes quarter `m XOR STEP_XOR[s]` at phase m (Li et al., "Neural video compression with diverse contexts", CVPR 2023).
After the first step, each quarter is decoded somewhere in the 3x3 neighbourhood of every position.

The first step has no decoded neighbours to predict from. Therefore it codes blocks of 2x2 positions, all four phases at
once, in three passes: blocks in even rows and columns, blocks in odd rows and columns, the others. Blocks of the second
and third pass have four decoded neighbour blocks.
"""

from collections.abc import Sequence
from typing import Any

import torch
from einops import rearrange
from jaxtyping import Float, Shaped
from torch import Tensor

NUM_STEPS = 4
NUM_PHASES = 4
STEP_XOR = (0, 3, 2, 1)  # its own inverse: quarter q is coded at phase m in step STEP_XOR[m XOR q]
# (row, column) offsets of the neighbour blocks that are decoded before each pass of the first step, in ascending order.
KNOWN_BLOCKS = ((), ((-1, -1), (-1, 1), (1, -1), (1, 1)), ((-1, 0), (0, -1), (0, 1), (1, 0)))
NUM_PASSES = len(KNOWN_BLOCKS)


def split_phases(x: Shaped[Tensor, "item height width channel"]) -> Shaped[Tensor, "4 item row column channel"]:
    """Split positions by phase. Height and width must be even."""
    return rearrange(x, "item (row a) (column b) channel -> (a b) item row column channel", a=2, b=2)


def merge_phases(x: Shaped[Tensor, "4 item row column channel"]) -> Shaped[Tensor, "item height width channel"]:
    """Invert `split_phases`."""
    return rearrange(x, "(a b) item row column channel -> item (row a) (column b) channel", a=2, b=2)


def to_coding_order(y: Float[Tensor, "item channel height width"]) -> Float[Tensor, "4 4 item row column quarter"]:
    """Rearrange a latent to [step phase item row column channel-in-quarter], the order of the bitstream."""
    parts = rearrange(y, "n (q c) (i a) (j b) -> q (a b) n i j c", q=4, a=2, b=2)
    phase = torch.arange(NUM_PHASES, device=y.device)
    quarter = phase ^ torch.tensor(STEP_XOR, device=y.device)[:, None]
    return parts[quarter, phase]


def from_coding_order(
    coded: Shaped[Tensor, "4 4 item row column quarter"],
) -> Shaped[Tensor, "item channel height width"]:
    """Invert `to_coding_order`."""
    phase = torch.arange(NUM_PHASES, device=coded.device)
    step = torch.tensor(STEP_XOR, device=coded.device)[phase ^ phase[:, None]]
    return rearrange(coded[step, phase], "q (a b) n i j c -> n (q c) (i a) (j b)", a=2, b=2)


def split_passes(x: Shaped[Tensor, "*some row column channel"]) -> list[Shaped[Tensor, "*some _ _ channel"]]:
    """Split blocks by pass. The third pass has all rows: odd columns of even rows, even columns of odd rows."""
    even, odd = x[..., 0::2, :, :], x[..., 1::2, :, :]
    rest = torch.stack((even[..., 1::2, :], odd[..., 0::2, :]), dim=-3).flatten(-4, -3)
    return [even[..., 0::2, :], odd[..., 1::2, :], rest]


def merge_passes(parts: Sequence[Float[Tensor, "*some _ _ channel"]]) -> Float[Tensor, "*some row column channel"]:
    """Invert `split_passes`. Blocks of missing later passes are zero."""
    *some, rows, columns, channels = parts[0].shape
    whole = parts[0].new_zeros(*some, 2 * rows, 2 * columns, channels)
    whole[..., 0::2, 0::2, :] = parts[0]
    if len(parts) > 1:
        whole[..., 1::2, 1::2, :] = parts[1]
    if len(parts) > 2:
        whole[..., 0::2, 1::2, :] = parts[2][..., 0::2, :, :]
        whole[..., 1::2, 0::2, :] = parts[2][..., 1::2, :, :]
    return whole


def blocks_around(
    x: Float[Tensor, "item row column channel"], offsets: Sequence[tuple[int, int]]
) -> Float[Tensor, "item row column columns"]:
    """Concatenate, for every block, its neighbour blocks at these (row, column) offsets; zero outside the grid."""
    rows, columns = x.shape[1:3]
    padded = torch.nn.functional.pad(x, (0, 0, 1, 1, 1, 1))
    return torch.cat([padded[:, 1 + i : 1 + i + rows, 1 + j : 1 + j + columns] for i, j in offsets], dim=-1)


def _rows_around(x: Tensor) -> tuple[Tensor, Tensor]:
    """Return x with a border of zeros, flattened to rows, and the nine row indices of each 3x3 neighbourhood."""
    items, height, width, channels = x.shape
    padded = torch.nn.functional.pad(x, (0, 0, 1, 1, 1, 1)).view(-1, channels)
    number = torch.arange(padded.shape[0], device=x.device).view(items, height + 2, width + 2)
    first = number[:, :height, :width, None]
    offsets = number[0, :3, :3].reshape(9)
    return padded, first + offsets


def _add_around(grad: Tensor) -> Tensor:
    """Return the gradient of x from that of `neighbourhoods(x)`; adding slices is faster than adding by index."""
    items, height, width, columns = grad.shape
    padded = grad.new_zeros(items, height + 2, width + 2, columns // 9)
    for offset, part in enumerate(grad.chunk(9, dim=-1)):
        i, j = divmod(offset, 3)
        padded[:, i : i + height, j : j + width] += part
    return padded[:, 1:-1, 1:-1]


class _Neighbourhoods(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        padded, rows = _rows_around(x)
        return padded.index_select(0, rows.flatten()).view(*x.shape[:3], -1)

    @staticmethod
    def backward(ctx: Any, grad: Tensor) -> Tensor:
        return _add_around(grad)


class _PhaseNeighbourhoods(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        padded, rows = _rows_around(x)
        rows = split_phases(rows)
        return padded.index_select(0, rows.flatten()).view(*rows.shape[:4], -1)

    @staticmethod
    def backward(ctx: Any, grad: Tensor) -> Tensor:
        return _add_around(merge_phases(grad))


def neighbourhoods(x: Float[Tensor, "item height width channel"]) -> Float[Tensor, "item height width columns"]:
    """Return the 3x3 neighbourhood of every position, columns ordered (row, column, channel); zero outside."""
    result: Tensor = _Neighbourhoods.apply(x)
    return result


def phase_neighbourhoods(x: Float[Tensor, "item height width channel"]) -> Float[Tensor, "4 item row column columns"]:
    """Return `split_phases(neighbourhoods(x))`, contiguous, with one copy."""
    result: Tensor = _PhaseNeighbourhoods.apply(x)
    return result
