"""Windows of the multi-view transformer: a map is cut into 2x2, shifted by half a window in every other block.

Shifted windows wrap around the border; a mask keeps tokens from attending across it (Liu et al., "Swin Transformer",
2021, figure 4).
"""

import math

import torch
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor

NUM_SPLITS = 2  # windows a side
BLOCKED = -100.0  # added to scores of pairs that lie across the border
_TEMPERATURE = 10000.0


def shift(h: int, w: int) -> tuple[int, int]:
    """Rows and columns by which shifted windows move: half a window."""
    return h // NUM_SPLITS // 2, w // NUM_SPLITS // 2


def into_windows(x: Float[Tensor, "*batch h w channel"]) -> Float[Tensor, "*batch window token channel"]:
    """Cut maps into windows, row by row, and their positions into tokens."""
    return rearrange(x, "... (r i) (s j) c -> ... (r s) (i j) c", r=NUM_SPLITS, s=NUM_SPLITS)


def from_windows(x: Float[Tensor, "*batch window token channel"], h: int) -> Float[Tensor, "*batch h w channel"]:
    """Inverse of `into_windows` for maps of height h."""
    return rearrange(x, "... (r s) (i j) c -> ... (r i) (s j) c", r=NUM_SPLITS, s=NUM_SPLITS, i=h // NUM_SPLITS)


def border_mask(h: int, w: int, device: torch.device) -> Float[Tensor, "window token token"]:
    """What shifted windows add to their scores: 0 within a region, BLOCKED between regions that only wrapping joins."""
    rows, columns = _bands(h, device), _bands(w, device)
    region = into_windows((3.0 * rows[:, None] + columns)[..., None])[..., 0]
    return (region[:, None] != region[..., None]) * BLOCKED


def _bands(length: int, device: torch.device) -> Int[Tensor, " length"]:
    """0 before the last window, 1 in its first half, 2 in its second, which wrapping brings from the other end."""
    position = torch.arange(length, device=device)
    window = length // NUM_SPLITS
    return (position >= length - window).long() + (position >= length - window // 2).long()


def masks_of_sources(mask: Float[Tensor, "window token token"], num_sources: int) -> Float[Tensor, "window token keys"]:
    """The mask for keys of several source views, one view after the other."""
    return mask.repeat(1, 1, num_sources)


def public_masks_of_sources(
    mask: Float[Tensor, "window token token"], num_sources: int
) -> Float[Tensor, "window token keys"]:
    """As the public code has it: it repeats the mask view by view, but its keys run through the views first.

    With one source view this is the same mask; with more, a key gets the entry of another position.
    """
    tokens = mask.shape[-1]
    entry = torch.arange(tokens * num_sources, device=mask.device) % tokens
    return mask[..., rearrange(entry, "(token source) -> (source token)", source=num_sources)]


def position_encoding(h: int, w: int, channels: int, device: torch.device) -> Float[Tensor, "h w channel"]:
    """Sines of the position inside each window, rows in the first half of the channels (Carion et al., "DETR")."""
    rows, columns = h // NUM_SPLITS, w // NUM_SPLITS
    along_rows, along_columns = (_waves(length, channels // 2, device) for length in (rows, columns))
    window = torch.cat((along_rows[:, None].expand(-1, columns, -1), along_columns[None].expand(rows, -1, -1)), dim=-1)
    return window.repeat(NUM_SPLITS, NUM_SPLITS, 1)


def _waves(length: int, channels: int, device: torch.device) -> Float[Tensor, "length channel"]:
    """Sine and cosine in turn, wavelengths growing geometrically; the whole length is one turn of the shortest."""
    position = torch.arange(1, length + 1, device=device) / (length + 1e-6) * 2 * math.pi
    exponent = torch.arange(channels // 2, device=device) / (channels // 2)
    angle = position[:, None] / _TEMPERATURE**exponent
    return rearrange(torch.stack((angle.sin(), angle.cos()), dim=-1), "n c two -> n (c two)")
