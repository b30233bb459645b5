"""DINOv2's ViT-S/14 as a frozen source of monocular features, stored as 8-bit integers (22 MB).

A tensor of at least SMALLEST_QUANTISED numbers and two dimensions is stored as int8, with one fp16 scale for each entry
of its first dimension (of the second for the position embedding): value = integer * scale, in float32. Other tensors
are fp16. The file is made by `benchmarks/quantise_dinov2.py` and never changes.
"""

import math
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int8
from torch import Tensor

from fecocodec.checkpoint import SHIPPED, load_into, read_stored_tensors, serialise_tensors
from fecocodec.errors import ModelError
from fecocodec.sender.extractors.vision_transformer import CHANNELS, PATCH, VisionTransformer, normalised

FILE = SHIPPED / "dinov2_vits14" / "backbone.safetensors"
SIDE = 252  # the images are resized to about SIDE^2 pixels
BLOCKS = (9, 12)  # of the 12, whose features are used
FEATURES = len(BLOCKS) * CHANNELS
SMALLEST_QUANTISED = 10_000
_LARGEST = 127
_SCALE = ".scale"


@torch.no_grad()
def dinov2_features(images: Float[Tensor, "item 3 h w"]) -> Float[Tensor, "item feature rows columns"]:
    """Return the features of two blocks for each patch of the images, resized to about 252x252 pixels.

    images: sRGB in [0, 1]. The resized sides are multiples of 14. Raises ModelError if the weights are missing.
    """
    height, width = images.shape[-2:]
    scale = SIDE / math.sqrt(height * width)
    size = [max(1, round(side * scale / PATCH)) * PATCH for side in (height, width)]
    resized = F.interpolate(images, size, mode="bilinear", align_corners=False, antialias=True)
    network = _network(images.device)
    return torch.cat(network.after_blocks(normalised(resized), BLOCKS), dim=1)


def serialise_dinov2(network: VisionTransformer) -> bytes:
    """Return the bytes of the file of 8-bit weights."""
    stored = {}
    for name, tensor in network.state_dict().items():
        if tensor.ndim < 2 or tensor.numel() < SMALLEST_QUANTISED:
            stored[name] = tensor.half().contiguous()
            continue
        stored[name], stored[name + _SCALE] = _quantised(tensor)
    return serialise_tensors(stored)


def load_dinov2(path: Path = FILE) -> VisionTransformer:
    """Return the network of a file of 8-bit weights, frozen. Raises ModelError if the file is missing or damaged."""
    if not path.is_file():
        raise ModelError(
            f"{path}: DINOv2's weights are not here; packages leave them out, so take this file from the repository, "
            "or make it by benchmarks/quantise_dinov2.py."
        )
    tensors = dict(_dequantised(read_stored_tensors(path), path))
    network = VisionTransformer()
    load_into(network, tensors, path)
    return network.eval().requires_grad_(False)


@cache
def _network(device: torch.device) -> VisionTransformer:
    return load_dinov2().to(device)


def _quantised(tensor: Tensor) -> tuple[Int8[Tensor, "*shape"], Float[Tensor, " row"]]:
    rows = _rows(tensor)
    scale = (rows.abs().amax(dim=1) / _LARGEST).half()
    integers = (rows / scale.float()[:, None]).round().clamp(-_LARGEST, _LARGEST).to(torch.int8)
    return integers.view_as(tensor).contiguous(), scale


def _dequantised(stored: dict[str, Tensor], place: Path) -> Iterator[tuple[str, Tensor]]:
    for name, tensor in stored.items():
        if name.endswith(_SCALE):
            continue
        if tensor.dtype != torch.int8:
            yield name, tensor.float()
            continue
        scale = stored.get(name + _SCALE)
        if scale is None or scale.shape != _rows(tensor).shape[:1]:
            raise ModelError(f"{place}: the scales of tensor '{name}' are missing or too few; reinstall the package.")
        yield name, (_rows(tensor).float() * scale.float()[:, None]).view_as(tensor)


def _rows(tensor: Tensor) -> Tensor:
    """Return the tensor as a matrix with one row for each scale."""
    return (tensor[0] if len(tensor) == 1 else tensor).flatten(1)
