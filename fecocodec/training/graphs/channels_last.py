"""Blocks of the networks in the form in which they are exported: equal up to rounding, with fewer copies.

Runtimes store maps with channels first or in blocks of channels. They join a transposition that directly precedes or
follows a convolution with their own conversion, so transpositions are exported beside convolutions only.
"""

from typing import TypeVar

import torch.nn.functional as F
from einops import rearrange
from torch import Tensor, nn

from fecocodec.layers.blocks import AdaptiveNorm, PixelShuffle, RateCondition

Network = TypeVar("Network", bound=nn.Module)


class ExportedNorm(nn.Module):
    """`AdaptiveNorm` for a condition of one item: the modulation is the affine part of the layer normalisation."""

    def __init__(self, norm: AdaptiveNorm) -> None:
        super().__init__()
        self.modulation = norm.modulation

    def forward(self, x: Tensor, condition: RateCondition) -> Tensor:
        gamma, beta = self.modulation(condition.embedding)[0].chunk(2)
        x = x.permute(0, 2, 3, 1)
        return F.layer_norm(x, x.shape[-1:], 1.0 + gamma, beta).permute(0, 3, 1, 2)


class ExportedUpsample(nn.Sequential):
    """`layers.blocks.upsample`: 1x1 convolution and pixel shuffle."""

    def forward(self, x: Tensor) -> Tensor:
        convolution = self[0]
        assert isinstance(convolution, nn.Conv2d)
        assert convolution.bias is not None
        return upsampled(x, convolution.weight[:, :, 0, 0], convolution.bias)


def upsampled(x: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
    """Return the pixel shuffle by two of a 1x1 convolution. weight: [4 * channels, in]; bias: [4 * channels].

    The convolution is a product of matrices with channels last, which has fewer channels to transpose. Its outputs are
    sorted by pixel instead of by channel, so that the shuffle copies whole pixels.
    """
    weight = rearrange(weight, "(c i j) inputs -> (i j c) inputs", i=2, j=2)
    bias = rearrange(bias, "(c i j) -> (i j c)", i=2, j=2)
    n, _, h, w = x.shape
    pixels = F.linear(x.permute(0, 2, 3, 1).flatten(0, 2), weight, bias)
    return rearrange(pixels, "(n h w) (i j c) -> n (h i) (w j) c", n=n, h=h, w=w, i=2, j=2).permute(0, 3, 1, 2)


def with_exported_blocks(module: Network) -> Network:
    """Replace the blocks of a module that have an exported form, in place, and return it."""
    for name, child in module.named_children():
        if isinstance(child, AdaptiveNorm):
            setattr(module, name, ExportedNorm(child))
        elif isinstance(child, nn.Sequential) and isinstance(child[-1], PixelShuffle):
            setattr(module, name, ExportedUpsample(*child))
        else:
            with_exported_blocks(child)
    return module
