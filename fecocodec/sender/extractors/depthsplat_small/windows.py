"""Windows of the multi-view transformer: a map is divided into 2x2 windows, shifted by half a window in every other
block.

Shifted windows wrap around the border; a mask prevents attention across it (Liu et al., "Swin Transformer", 2021,
figure 4).
"""

import math

import torch
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor

NUM_SPLITS = 2  # windows per side
BLOCKED = -100.0  # added to the attention scores of masked pairs
_TEMPERATURE = 10000.0


def shift(h: int, w: int) -> tuple[int, int]:
    """Return the shift of shifted windows, in rows and columns: half a window."""
    return h // NUM_SPLITS // 2, w // NUM_SPLITS // 2


def into_windows(x: Float[Tensor, "*batch h w channel"]) -> Float[Tensor, "*batch window token channel"]:
    """Divide maps into windows in row-major order, and flatten the positions of each window to tokens."""
    return rearrange(x, "... (r i) (s j) c -> ... (r s) (i j) c", r=NUM_SPLITS, s=NUM_SPLITS)


def from_windows(x: Float[Tensor, "*batch window token channel"], h: int) -> Float[Tensor, "*batch h w channel"]:
    """Inverse of `into_windows` for maps of height h."""
    return rearrange(x, "... (r s) (i j) c -> ... (r i) (s j) c", r=NUM_SPLITS, s=NUM_SPLITS, i=h // NUM_SPLITS)


def border_mask(h: int, w: int, device: torch.device) -> Float[Tensor, "window token token"]:
    """Return the additive mask of shifted windows: BLOCKED between regions adjacent only by wrapping, else 0."""
    rows, columns = _bands(h, device), _bands(w, device)
    region = into_windows((3.0 * rows[:, None] + columns)[..., None])[..., 0]
    return (region[:, None] != region[..., None]) * BLOCKED


def _bands(length: int, device: torch.device) -> Int[Tensor, " length"]:
    """Return region numbers along one axis: 0 before the last window, 1 in its first half, 2 in its wrapped half."""
    position = torch.arange(length, device=device)
    window = length // NUM_SPLITS
    return (position >= length - window).long() + (position >= length - window // 2).long()


def masks_of_sources(mask: Float[Tensor, "window token token"], num_sources: int) -> Float[Tensor, "window token keys"]:
    """Return the mask for the concatenated keys of several source views."""
    return mask.repeat(1, 1, num_sources)


def public_masks_of_sources(
    mask: Float[Tensor, "window token token"], num_sources: int
) -> Float[Tensor, "window token keys"]:
    """Return the mask as the public code applies it; its checkpoints were trained with it.

    The public code repeats the mask per view, but orders the keys by token first. With one source view this equals
    `masks_of_sources`; with more, keys get the mask entry of another position.
    """
    tokens = mask.shape[-1]
    entry = torch.arange(tokens * num_sources, device=mask.device) % tokens
    return mask[..., rearrange(entry, "(token source) -> (source token)", source=num_sources)]


def position_encoding(h: int, w: int, channels: int, device: torch.device) -> Float[Tensor, "h w channel"]:
    """Return the sine position encoding inside each window (Carion et al., "DETR", 2020); rows are encoded in the
    first half of the channels, columns in the second."""
    rows, columns = h // NUM_SPLITS, w // NUM_SPLITS
    along_rows, along_columns = (_waves(length, channels // 2, device) for length in (rows, columns))
    window = torch.cat((along_rows[:, None].expand(-1, columns, -1), along_columns[None].expand(rows, -1, -1)), dim=-1)
    return window.repeat(NUM_SPLITS, NUM_SPLITS, 1)


def _waves(length: int, channels: int, device: torch.device) -> Float[Tensor, "length channel"]:
    """Return alternating sines and cosines; wavelengths grow geometrically from one period over the whole length."""
    position = torch.arange(1, length + 1, device=device) / (length + 1e-6) * 2 * math.pi
    exponent = torch.arange(channels // 2, device=device) / (channels // 2)
    angle = position[:, None] / _TEMPERATURE**exponent
    return rearrange(torch.stack((angle.sin(), angle.cos()), dim=-1), "n c two -> n (c two)")
