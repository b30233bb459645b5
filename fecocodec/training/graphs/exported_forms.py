"""Parts of the networks in the form in which they are exported: blocks, fixed-point layers, and sampling.

Blocks are equal up to rounding, with fewer copies. Runtimes store maps with channels first or in blocks of channels.
They join a transposition that directly precedes or follows a convolution with their own conversion, so transpositions
are exported beside convolutions only. Fixed-point layers have integer weights and exact sums. Sampling is equal up to
rounding to `grid_sample`, and twice as fast: onnxruntime computes GridSample one value after another, while here the
rows of two neighbouring cells are gathered for each sample, and all samples are interpolated together.
"""

from typing import TypeVar

import torch
import torch.nn.functional as F
from einops import rearrange
from torch import Tensor, nn

from fecocodec.coding.fixed_point import (
    ACTIVATION_HIGHEST,
    ACTIVATION_LOWEST,
    WEIGHT_BITS,
    FixedPointLinear,
    export_integers,
)
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


class ExactLinear(nn.Module):
    """`FixedPointLinear` with the integers of the weights file as buffers: clip((x @ weight + bias + 2^11) >> 12).

    Sums are computed in float64, where they are multiples of 2^-12 below 2^41 and therefore exact in any order.
    Runtimes divide the weights when they load the graph.
    """

    weight: Tensor
    bias: Tensor

    def __init__(self, layer: FixedPointLinear) -> None:
        super().__init__()
        for name, integers in export_integers(layer).items():
            self.register_buffer(name.removeprefix("."), integers)

    def forward(self, *inputs_q8: Tensor) -> Tensor:
        weight, half = self.weight.double() / (1 << WEIGHT_BITS), 0.5  # floor rounds to nearest with the half
        sums = self.bias[:, None].double() / (1 << WEIGHT_BITS) + half
        first = 0
        for x_q8 in inputs_q8:
            last = first + x_q8.shape[-1]
            sums = sums + x_q8 @ weight[:, first:last]
            first = last
        return torch.floor(sums).clamp(ACTIVATION_LOWEST, ACTIVATION_HIGHEST)


def with_exported_forms(module: Network) -> Network:
    """Replace the blocks and layers of a module that have an exported form, in place, and return it."""
    for name, child in module.named_children():
        if isinstance(child, AdaptiveNorm):
            setattr(module, name, ExportedNorm(child))
        elif isinstance(child, nn.Sequential) and isinstance(child[-1], PixelShuffle):
            setattr(module, name, ExportedUpsample(*child))
        elif isinstance(child, FixedPointLinear):
            setattr(module, name, ExactLinear(child))
        else:
            with_exported_forms(child)
    return module


BILINEAR, BORDER = 0, 1  # numbers of the modes of `grid_sampler`


def sampled(values: Tensor, positions: Tensor, mode: int, padding: int, align_corners: bool) -> Tensor:
    """Sample maps [view, channel, height, width] at positions [view, rows, columns, 2] from -1 to 1: `grid_sampler`.

    height and width are at least 2. Raises ValueError for modes that the receiver does not use.
    """
    if (mode, padding, align_corners) != (BILINEAR, BORDER, False):
        raise ValueError("only bilinear sampling with replicated borders, align_corners=False, has an exported form.")
    views, channels, height, width = values.shape
    left, right_share = _cells(positions[..., 0].flatten(), width)
    top, lower_share = _cells(positions[..., 1].flatten(), height)
    first = torch.arange(views, device=values.device)[:, None] * (height * width)
    upper_index = ((top * width + left).view(views, -1) + first).flatten()
    rows = values.permute(0, 2, 3, 1).reshape(-1, channels)
    both = torch.cat((rows, F.pad(rows[1:], (0, 0, 0, 1))), dim=1)  # each cell and the next one
    upper_left, upper_right = both.index_select(0, upper_index).transpose(0, 1).chunk(2)
    lower_left, lower_right = both.index_select(0, upper_index + width).transpose(0, 1).chunk(2)
    upper = upper_left + (upper_right - upper_left) * right_share
    lower = lower_left + (lower_right - lower_left) * right_share
    found = (upper + (lower - upper) * lower_share).view(channels, views, *positions.shape[1:3])
    return found.transpose(0, 1)


def _cells(positions: Tensor, side: int) -> tuple[Tensor, Tensor]:
    """Return the first of the two cells that surround each position along an axis, and the share of the second."""
    at = ((positions + 1.0) * (0.5 * side) - 0.5).clamp(0, side - 1)
    first = at.floor().long().clamp(0, side - 2)  # after the conversion, whose result for NaN can be any number
    return first, at - first
