"""Networks in bfloat16 while everything that measures space, light or bits stays float32."""

from collections.abc import Callable, Iterator
from typing import Any

import torch
from torch import Tensor, nn

from fecocodec.coding.priors import LatentPrior
from fecocodec.layers.blocks import RateEmbedding
from fecocodec.receiver.model import Receiver
from fecocodec.receiver.neighbour_attention import NeighbourAttention
from fecocodec.receiver.predictor import Predictor
from fecocodec.sender.extractors.compact import CompactExtractor
from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall
from fecocodec.sender.model import Sender

# Their own forward passes compute cameras, depths or correlations; of these, the parts are converted one by one.
_TAKEN_APART = (nn.ModuleDict, nn.ModuleList, Sender, Receiver, CompactExtractor, DepthSplatSmall, Predictor)
# Integers, positions in space, and what conditions everything.
_KEPT = (LatentPrior, NeighbourAttention, RateEmbedding)
_KEPT_HEADS = ("depth_head", "matching_head")  # depth, and the features whose products are matched


def run_in_bfloat16(networks: nn.Module, device: str) -> None:
    """Let the convolutional and attention parts of both ends compute in bfloat16; parameters stay float32.

    What passes between the parts, and so cameras, depth, Gaussians, rendering, rate and loss, is float32.
    """
    for part in _convertible(networks):
        part.forward = _in_bfloat16(part.forward, torch.device(device).type)


def _convertible(module: nn.Module) -> Iterator[nn.Module]:
    for name, child in module.named_children():
        if isinstance(child, _KEPT) or name in _KEPT_HEADS:
            continue
        if type(child) in _TAKEN_APART:
            yield from _convertible(child)
        else:
            yield child


def _in_bfloat16(forward: Callable[..., Tensor], device_type: str) -> Callable[..., Tensor]:
    def converted(*inputs: Any) -> Tensor:
        with torch.autocast(device_type, torch.bfloat16):
            return forward(*inputs).float()

    return converted
