"""Cross-view attention at 1/8 resolution."""

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor, nn

LARGEST_KEY_SIDE = 32  # keys are pooled to at most 32x32 positions, so that cost is linear in the number of pixels


class CrossViewAttention(nn.Module):
    """Pre-norm attention of each view to its own tokens and those of its source views, then an MLP; both residual."""

    def __init__(self, channels: int, num_heads: int = 4) -> None:
        super().__init__()
        self.num_heads = num_heads
        self.norm_query, self.norm_mlp = nn.LayerNorm(channels), nn.LayerNorm(channels)
        self.query, self.key_value = nn.Linear(channels, channels), nn.Linear(channels, 2 * channels)
        self.own_or_other = nn.Parameter(0.02 * torch.randn(2, channels))
        self.output = nn.Linear(channels, channels)
        hidden = 2 * channels
        self.mlp = nn.Sequential(nn.Linear(channels, hidden), nn.GELU(approximate="tanh"), nn.Linear(hidden, channels))

    def forward(
        self, x: Float[Tensor, "batch view channel h w"], sources: Int[Tensor, "batch view count"]
    ) -> Float[Tensor, "batch view channel h w"]:
        batch, views, _, height, width = x.shape
        tokens = rearrange(x, "b v c h w -> b v (h w) c")
        normed = self.norm_query(tokens)
        keys = _pool(rearrange(normed, "b v (h w) c -> (b v) c h w", h=height))
        keys = rearrange(keys, "(b v) t c -> b v t c", v=views)
        batch_index = torch.arange(batch, device=x.device)[:, None, None]
        others = rearrange(keys[batch_index, sources] + self.own_or_other[1], "b v s t c -> b v (s t) c")
        context = torch.cat((keys + self.own_or_other[0], others), dim=2)
        tokens = tokens + self._attend(normed, context)
        tokens = tokens + self.mlp(self.norm_mlp(tokens))
        return rearrange(tokens, "b v (h w) c -> b v c h w", h=height, w=width)

    def _attend(self, normed: Tensor, context: Tensor) -> Tensor:
        query = rearrange(self.query(normed), "b v t (n c) -> (b v) n t c", n=self.num_heads)
        key, value = rearrange(self.key_value(context), "b v t (two n c) -> two (b v) n t c", two=2, n=self.num_heads)
        attended = F.scaled_dot_product_attention(query, key, value)
        return self.output(rearrange(attended, "(b v) n t c -> b v t (n c)", v=normed.shape[1]))


def _pool(x: Float[Tensor, "item channel h w"]) -> Float[Tensor, "item token channel"]:
    size = (min(x.shape[-2], LARGEST_KEY_SIDE), min(x.shape[-1], LARGEST_KEY_SIDE))
    return rearrange(F.adaptive_avg_pool2d(x, size), "i c h w -> i (h w) c")
