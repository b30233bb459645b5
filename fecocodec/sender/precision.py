"""Run convolutions and attention in bfloat16; geometry, colours and rates stay in float32."""

from collections.abc import Callable, Iterator
from typing import Any

import torch
from torch import Tensor, nn

from fecocodec.coding.priors import LatentPrior
from fecocodec.layers.blocks import RateEmbedding
from fecocodec.receiver.model import Receiver
from fecocodec.receiver.neighbour_attention import NeighbourAttention
from fecocodec.receiver.predictor import Predictor
from fecocodec.sender.extractors.protocol import Extractor
from fecocodec.sender.model import Sender

# Their forward passes compute projections, depths or correlations, so only their submodules are converted.
_CONVERTED_BY_PART = (nn.ModuleDict, nn.ModuleList, Sender, Receiver, Predictor)
# Not converted: integer arithmetic, 3D positions, and the conditioning of all blocks.
_KEPT = (LatentPrior, NeighbourAttention, RateEmbedding)
_KEPT_HEADS = ("depth_head", "matching_head")  # depth, and the features of the cost volume


def run_in_bfloat16(networks: nn.Module, device: str) -> None:
    """Make the convolutional and attention modules compute in bfloat16, in place. Parameters stay in float32.

    The inputs and outputs of these modules are float32, as are cameras, depth, Gaussians, rendering, rate and loss.
    device: where the networks run, such as "cpu" or "cuda".
    """
    for part in _convertible(networks):
        part.forward = _in_bfloat16(part.forward, torch.device(device).type)


def _convertible(module: nn.Module) -> Iterator[nn.Module]:
    for name, child in module.named_children():
        if isinstance(child, _KEPT) or name in _KEPT_HEADS:
            continue
        if type(child) in _CONVERTED_BY_PART or isinstance(child, Extractor):
            yield from _convertible(child)
        else:
            yield child


def _in_bfloat16(forward: Callable[..., Tensor], device_type: str) -> Callable[..., Tensor]:
    def converted(*inputs: Any) -> Tensor:
        with torch.autocast(device_type, torch.bfloat16):
            return forward(*inputs).float()

    return converted
