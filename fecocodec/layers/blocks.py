"""Blocks shared by the sender's and the receiver's networks. Maps are `[item channel h w]`, item = (batch view)."""

from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from contextvars import ContextVar
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float, Int
from torch import Tensor, nn

CONDITION_CHANNELS = 64
FeatureMaps = Float[Tensor, "item channel h w"]
_ARE_GRADIENTS_DIRECT = ContextVar("are_gradients_direct", default=False)


@contextmanager
def direct_gradients() -> Iterator[None]:
    """Treat the output of every `residual_branch` inside this context as a constant in gradients."""
    before = _ARE_GRADIENTS_DIRECT.set(True)
    try:
        yield
    finally:
        _ARE_GRADIENTS_DIRECT.reset(before)


@contextmanager
def residual_branch() -> Iterator[None]:
    """Mark a residual branch; `direct_gradients` treats its output as a constant."""
    with torch.set_grad_enabled(torch.is_grad_enabled() and not _ARE_GRADIENTS_DIRECT.get()):
        yield


@dataclass(frozen=True)
class RateCondition:
    """Condition of the codec's networks on lambda and stage.

    embedding: modulates the 2D blocks. latent_gain: g_a multiplies by it and g_s divides, so that the quantisation step
    of the latents follows lambda.
    """

    embedding: Float[Tensor, "item condition"]
    latent_gain: Float[Tensor, "item 1 1 1"]


class RateEmbedding(nn.Module):
    """(lambda_q, stage) -> MLP -> condition that modulates every `Block2d` of the codec.

    The paper conditions on log(lambda) (section 3.4); `lambda_q` is that logarithm in the fixed point of the container.
    The gain of the latent is `largest_gain` at lambda 1e-5 and proportional to lambda^-gain_exponent.
    """

    def __init__(self, largest_lambda_q: int, largest_gain: float, gain_exponent: float) -> None:
        super().__init__()
        self.largest_lambda_q, self.largest_gain, self.gain_exponent = largest_lambda_q, largest_gain, gain_exponent
        self.mlp = nn.Sequential(
            RowsLinear(3, CONDITION_CHANNELS), nn.GELU(), RowsLinear(CONDITION_CHANNELS, CONDITION_CHANNELS), nn.GELU()
        )

    def forward(self, lambda_q: Int[Tensor, " item"], stage: int) -> RateCondition:
        """Return the condition of each item. lambda_q: lambda in the fixed point of streams. stage: 1 or 2."""
        position = 2.0 * lambda_q / self.largest_lambda_q - 1.0
        is_second = torch.full_like(position, float(stage == 2))
        embedding = self.mlp(torch.stack((position, position * is_second, is_second), dim=-1))
        gain = self.largest_gain * torch.exp(-self.gain_exponent * lambda_q / 256.0)
        return RateCondition(embedding, gain[:, None, None, None])


class ChannelNorm(nn.Module):
    """Layer normalisation over the channels of each position of a map, without affine part."""

    def forward(self, x: FeatureMaps) -> FeatureMaps:
        channels_last = x.permute(0, 2, 3, 1)
        return F.layer_norm(channels_last, channels_last.shape[-1:]).permute(0, 3, 1, 2)


class AdaptiveNorm(nn.Module):
    """AdaLN: gamma(condition) * LN(x) + beta(condition), per channel (paper, equation of section 3.4)."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.norm = ChannelNorm()
        self.modulation = RowsLinear(CONDITION_CHANNELS, 2 * channels)
        nn.init.normal_(self.modulation.weight, std=0.01)
        nn.init.zeros_(self.modulation.bias)

    def forward(self, x: FeatureMaps, condition: RateCondition) -> FeatureMaps:
        gamma, beta = self.modulation(condition.embedding)[:, :, None, None].chunk(2, dim=1)
        return torch.addcmul(beta, self.norm(x), 1.0 + gamma)


class RowsLinear(nn.Linear):
    """Linear layer of one row per item, computed for four rows at a time.

    Matrix products of 5 to 11 rows sum in an order that depends on the number of threads; those of up to 4 do not.
    """

    def forward(self, x: Float[Tensor, "item input"]) -> Float[Tensor, "item channel"]:
        if torch.compiler.is_exporting():
            return super().forward(x)
        return torch.cat([F.linear(rows, self.weight, self.bias) for rows in x.split(4)])


class PointwiseConv2d(nn.Conv2d):
    """1x1 convolution of stride 1, computed by `pointwise`."""

    def __init__(self, in_channels: int, out_channels: int) -> None:
        super().__init__(in_channels, out_channels, 1)

    def forward(self, x: Float[Tensor, "item input h w"]) -> FeatureMaps:
        return pointwise(x, self.weight, self.bias)


def pointwise(
    x: Float[Tensor, "item input h w"],
    weight: Float[Tensor, "channel input 1 1"],
    bias: Float[Tensor, " channel"] | None = None,
) -> FeatureMaps:
    """Return the 1x1 convolution of x as a matrix product.

    The 1x1 convolutions of oneDNN sum in an order that depends on the number of threads; matrix products of these sizes
    do not, and have the bits of oneDNN with one thread. Exported graphs have a convolution, which is faster there.
    """
    if torch.compiler.is_exporting():
        return F.conv2d(x, weight, bias)
    return F.linear(x.permute(0, 2, 3, 1), weight.flatten(1), bias).permute(0, 3, 1, 2)


class Block2d(nn.Module):
    """x -> AdaLN(condition) -> 3x3 conv -> GELU -> 1x1 conv -> + x: the codec's 2D block.

    On a CPU a dense 3x3 convolution reaches three times the throughput of a depthwise one (docs/what_we_learned.md),
    so the block is wide and short instead of a chain of depthwise layers.
    """

    def __init__(self, channels: int, hidden: int, is_residual_branch: bool = False) -> None:
        """is_residual_branch: whether `direct_gradients` treats what the block adds to x as a constant."""
        super().__init__()
        self.is_residual_branch = is_residual_branch
        self.norm = AdaptiveNorm(channels)
        self.spatial = nn.Conv2d(channels, hidden, 3, padding=1)
        self.pointwise = PointwiseConv2d(hidden, channels)

    def forward(self, x: FeatureMaps, condition: RateCondition) -> FeatureMaps:
        with residual_branch() if self.is_residual_branch else nullcontext():
            added = self.pointwise(F.gelu(self.spatial(self.norm(x, condition)), approximate="tanh"))
        return added + x


class PlainBlock2d(nn.Module):
    """`Block2d` without a condition, for networks that must not depend on lambda (the extractor)."""

    def __init__(self, channels: int, hidden: int) -> None:
        super().__init__()
        self.norm = ChannelNorm()
        self.spatial = nn.Conv2d(channels, hidden, 3, padding=1)
        self.pointwise = PointwiseConv2d(hidden, channels)

    def forward(self, x: FeatureMaps) -> FeatureMaps:
        return self.pointwise(F.gelu(self.spatial(self.norm(x)), approximate="tanh")).add_(x)


class BlockChain(nn.ModuleList):
    """A sequence of `Block2d`."""

    def __init__(self, channels: int, hidden: int, depth: int) -> None:
        super().__init__(Block2d(channels, hidden) for _ in range(depth))

    def forward(self, x: FeatureMaps, condition: RateCondition) -> FeatureMaps:
        for block in self:
            x = block(x, condition)
        return x


def downsample(in_channels: int, out_channels: int) -> nn.Conv2d:
    """Downsample by two: 2x2 convolution of stride 2."""
    return nn.Conv2d(in_channels, out_channels, 2, stride=2)


def upsample(in_channels: int, out_channels: int) -> nn.Sequential:
    """Upsample by two: 1x1 convolution and pixel shuffle."""
    return nn.Sequential(PointwiseConv2d(in_channels, 4 * out_channels), PixelShuffle())


class PixelShuffle(nn.Module):
    """`pixel_shuffle` as a module."""

    def forward(self, x: Float[Tensor, "item channels4 h w"]) -> Float[Tensor, "item channel h2 w2"]:
        return pixel_shuffle(x)


def pixel_shuffle(x: Float[Tensor, "item _ h w"], factor: int = 2) -> Float[Tensor, "item channel _ _"]:
    """Rearrange channels to pixels, as `torch.nn.functional.pixel_shuffle`, with channels last in memory.

    Torch's function returns channels first, which every following layer would convert.
    """
    return rearrange(x, "n (c i j) h w -> n (h i) (w j) c", i=factor, j=factor).permute(0, 3, 1, 2)
