"""The multi-view transformer: windowed self-attention, and attention to source views (Xu et al., "UniMatch", 2023)."""

import math
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor, nn

NUM_SPLITS = 2  # windows per side
BLOCKED = -100.0  # added to the attention scores of masked pairs
_TEMPERATURE = 10000.0
Mask = Float[Tensor, "window token token"]
KeyMask = Float[Tensor, "window token keys"]  # for the keys of several source views
Tokens = Float[Tensor, "item window token channel"]


def shift(h: int, w: int) -> tuple[int, int]:
    """Return the shift of shifted windows, in rows and columns: half a window."""
    return h // NUM_SPLITS // 2, w // NUM_SPLITS // 2


def into_windows(x: Float[Tensor, "*batch h w channel"]) -> Float[Tensor, "*batch window token channel"]:
    """Divide maps into windows in row-major order, and flatten the positions of each window to tokens."""
    return rearrange(x, "... (r i) (s j) c -> ... (r s) (i j) c", r=NUM_SPLITS, s=NUM_SPLITS)


def from_windows(x: Float[Tensor, "*batch window token channel"], h: int) -> Float[Tensor, "*batch h w channel"]:
    """Inverse of `into_windows` for maps of height h."""
    return rearrange(x, "... (r s) (i j) c -> ... (r i) (s j) c", r=NUM_SPLITS, s=NUM_SPLITS, i=h // NUM_SPLITS)


def border_mask(h: int, w: int, device: torch.device) -> Mask:
    """Return the additive mask of shifted windows: BLOCKED between regions adjacent only by wrapping, else 0."""
    rows, columns = _bands(h, device), _bands(w, device)
    region = into_windows((3.0 * rows[:, None] + columns)[..., None])[..., 0]
    return (region[:, None] != region[..., None]) * BLOCKED


def _bands(length: int, device: torch.device) -> Int[Tensor, " length"]:
    """Return region numbers along one axis: 0 before the last window, 1 in its first half, 2 in its wrapped half."""
    position = torch.arange(length, device=device)
    window = length // NUM_SPLITS
    return (position >= length - window).long() + (position >= length - window // 2).long()


def masks_of_sources(mask: Mask, num_sources: int) -> KeyMask:
    """Return the mask for the concatenated keys of several source views."""
    return mask.repeat(1, 1, num_sources)


def public_masks_of_sources(mask: Mask, num_sources: int) -> KeyMask:
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


CHANNELS = 128
NUM_BLOCKS = 6


@dataclass(frozen=True)
class ScoreMasks:
    """Additive masks of attention scores in shifted windows, for self-attention and for attention to sources."""

    within: Mask
    across: KeyMask


class AttentionLayer(nn.Module):
    """Single-head attention in windows -> linear -> layer norm -> + x."""

    def __init__(self) -> None:
        super().__init__()
        self.q_proj, self.k_proj, self.v_proj, self.merge = (_linear(CHANNELS, CHANNELS) for _ in range(4))
        self.norm1 = nn.LayerNorm(CHANNELS)

    def message(self, x: Tokens, keys: Float[Tensor, "item window keys channel"], mask: KeyMask | None) -> Tokens:
        """Return the attention output of each token over the keys of its window."""
        query, key, value = self.q_proj(x), self.k_proj(keys), self.v_proj(keys)
        return self.norm1(self.merge(F.scaled_dot_product_attention(query, key, value, mask)))

    def forward(self, x: Tokens, mask: Mask | None) -> Tokens:
        return x + self.message(x, x, mask)


class CrossAttentionLayer(AttentionLayer):
    """Attention to tokens of the source views -> MLP of (token, message) -> layer norm -> + x."""

    def __init__(self) -> None:
        super().__init__()
        self.mlp = nn.Sequential(_linear(2 * CHANNELS, 8 * CHANNELS), nn.GELU(), _linear(8 * CHANNELS, CHANNELS))
        self.norm2 = nn.LayerNorm(CHANNELS)

    def forward(  # type: ignore[override]
        self, x: Tokens, keys: Float[Tensor, "item window keys channel"], mask: KeyMask | None
    ) -> Tokens:
        gathered = self.message(x, keys, mask)
        return x + self.norm2(self.mlp(torch.cat((x, gathered), dim=-1)))


class Block(nn.Module):
    """Self-attention, then attention to the tokens of the source views at the input of this block."""

    def __init__(self) -> None:
        super().__init__()
        self.self_attn, self.cross_attn_ffn = AttentionLayer(), CrossAttentionLayer()

    def forward(
        self,
        maps: Float[Tensor, "batch view h w channel"],
        sources: Int[Tensor, "batch view count"],
        masks: ScoreMasks | None,
    ) -> Float[Tensor, "batch view h w channel"]:
        """masks: None for windows that are not shifted."""
        batch, _, h, w, _ = maps.shape
        step = shift(h, w) if masks else (0, 0)
        tokens = into_windows(maps.roll((-step[0], -step[1]), dims=(2, 3)))
        gathered = tokens[torch.arange(batch, device=maps.device)[:, None, None], sources]
        keys = rearrange(gathered, "b v s n t c -> (b v) n (s t) c")
        tokens = rearrange(tokens, "b v n t c -> (b v) n t c")
        tokens = self.self_attn(tokens, masks.within if masks else None)
        tokens = self.cross_attn_ffn(tokens, keys, masks.across if masks else None)
        return from_windows(rearrange(tokens, "(b v) n t c -> b v n t c", b=batch), h).roll(step, dims=(2, 3))


class MultiViewTransformer(nn.Module):
    """CNN features + position encoding -> six blocks; every other block uses shifted windows."""

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.ModuleList(Block() for _ in range(NUM_BLOCKS))
        for parameter in self.parameters():
            if parameter.dim() > 1:
                nn.init.xavier_uniform_(parameter)

    def forward(
        self,
        features: Float[Tensor, "batch view channel h w"],
        sources: Int[Tensor, "batch view count"],
        masks: ScoreMasks,
    ) -> Float[Tensor, "batch view channel h w"]:
        """sources: indices of the views that each view attends to, at least one."""
        h, w = features.shape[-2:]
        maps = rearrange(features, "b v c h w -> b v h w c") + position_encoding(h, w, CHANNELS, features.device)
        for number, block in enumerate(self.layers):
            maps = block(maps, sources, masks if number % 2 else None)
        return rearrange(maps, "b v h w c -> b v c h w")


def _linear(in_channels: int, out_channels: int) -> nn.Linear:
    return nn.Linear(in_channels, out_channels, bias=False)
