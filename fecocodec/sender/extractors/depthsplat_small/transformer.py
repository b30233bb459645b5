"""The multi-view transformer: windowed self-attention, and attention to source views (Xu et al., "UniMatch", 2023)."""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor, nn

from fecocodec.sender.extractors.depthsplat_small.windows import (
    from_windows,
    into_windows,
    position_encoding,
    shift,
)

CHANNELS = 128
NUM_BLOCKS = 6


@dataclass(frozen=True)
class ScoreMasks:
    """Additive masks of attention scores in shifted windows, for self-attention and for attention to sources."""

    within: Float[Tensor, "window token token"]
    across: Float[Tensor, "window token keys"]


class AttentionLayer(nn.Module):
    """Single-head attention in windows -> linear -> layer norm -> + x."""

    def __init__(self) -> None:
        super().__init__()
        self.q_proj, self.k_proj, self.v_proj, self.merge = (_linear(CHANNELS, CHANNELS) for _ in range(4))
        self.norm1 = nn.LayerNorm(CHANNELS)

    def message(
        self,
        x: Float[Tensor, "item window token channel"],
        keys: Float[Tensor, "item window keys channel"],
        mask: Float[Tensor, "window token keys"] | None,
    ) -> Float[Tensor, "item window token channel"]:
        """Return the attention output of each token over the keys of its window."""
        query, key, value = self.q_proj(x), self.k_proj(keys), self.v_proj(keys)
        return self.norm1(self.merge(F.scaled_dot_product_attention(query, key, value, mask)))

    def forward(
        self,
        x: Float[Tensor, "item window token channel"],
        mask: Float[Tensor, "window token token"] | None,
    ) -> Float[Tensor, "item window token channel"]:
        return x + self.message(x, x, mask)


class CrossAttentionLayer(AttentionLayer):
    """Attention to tokens of the source views -> MLP of (token, message) -> layer norm -> + x."""

    def __init__(self) -> None:
        super().__init__()
        self.mlp = nn.Sequential(_linear(2 * CHANNELS, 8 * CHANNELS), nn.GELU(), _linear(8 * CHANNELS, CHANNELS))
        self.norm2 = nn.LayerNorm(CHANNELS)

    def forward(  # type: ignore[override]
        self,
        x: Float[Tensor, "item window token channel"],
        keys: Float[Tensor, "item window keys channel"],
        mask: Float[Tensor, "window token keys"] | None,
    ) -> Float[Tensor, "item window token channel"]:
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
