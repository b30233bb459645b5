"""Fixed-point layers in the form in which they are exported: integer weights, exact sums."""

from typing import TypeVar

import torch
from torch import Tensor, nn

from fecocodec.coding.fixed_point import (
    ACTIVATION_HIGHEST,
    ACTIVATION_LOWEST,
    WEIGHT_BITS,
    FixedPointLinear,
    export_integers,
)

Network = TypeVar("Network", bound=nn.Module)


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


def with_exact_layers(module: Network) -> Network:
    """Replace all fixed-point layers of a module, in place, and return it."""
    for name, child in module.named_children():
        if isinstance(child, FixedPointLinear):
            setattr(module, name, ExactLinear(child))
        else:
            with_exact_layers(child)
    return module
