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

    Sums are computed in float64, where they are integers below 2^53 and therefore exact in any order.
    """

    weight: Tensor
    bias: Tensor

    def __init__(self, layer: FixedPointLinear) -> None:
        super().__init__()
        for name, integers in export_integers(layer).items():
            self.register_buffer(name.removeprefix("."), integers)

    def forward(self, *inputs_q8: Tensor) -> Tensor:
        half = 1 << (WEIGHT_BITS - 1)
        sums = self.bias[:, None].double() + half
        first = 0
        for x_q8 in inputs_q8:
            last = first + x_q8.shape[-1]
            sums = sums + x_q8 @ self.weight[:, first:last].double()
            first = last
        return torch.floor(sums / (1 << WEIGHT_BITS)).clamp(ACTIVATION_LOWEST, ACTIVATION_HIGHEST)


def with_exact_layers(module: Network) -> Network:
    """Replace all fixed-point layers of a module, in place, and return it."""
    for name, child in module.named_children():
        if isinstance(child, FixedPointLinear):
            setattr(module, name, ExactLinear(child))
        else:
            with_exact_layers(child)
    return module
