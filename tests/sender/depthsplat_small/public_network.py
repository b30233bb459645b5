"""The public network's reference outputs, and the rule that made its weights up."""

import json
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from unittest.mock import patch

import numpy as np
import torch
from torch import Tensor, nn

from fecocodec.geometry.cameras import Cameras
from fecocodec.sender.extractors.depthsplat_small.extractor import DepthSplatSmall

HERE = Path(__file__).parent
SHIPPED = HERE / "public_outputs.npz"
SHAPES: dict[str, list[int]] = json.loads((HERE / "public_tensors.json").read_text())


def views_of(arrays: dict[str, np.ndarray]) -> tuple[Tensor, Cameras]:
    images = torch.from_numpy((arrays["images"] / 65535).astype(np.float32))[None]
    near, far = (torch.from_numpy(arrays[name][:1]) for name in ("near", "far"))
    return images, Cameras(
        torch.from_numpy(arrays["extrinsics"])[None], torch.from_numpy(arrays["intrinsics"])[None], near, far
    )


def require_near(found: Tensor, expected: np.ndarray, name: str) -> None:
    difference, scale = found - torch.from_numpy(expected), torch.from_numpy(expected)
    assert difference.norm() < 1e-5 * scale.norm(), name  # measured: 5e-6 at most
    assert difference.abs().max() < 1e-4 * scale.abs().max(), name


def made_up_tensor(name: str, shape: list[int]) -> Tensor:
    generator = np.random.Generator(np.random.PCG64(zlib.crc32(name.encode())))
    values = generator.standard_normal(shape)
    if len(shape) >= 2:
        values *= 0.7 / np.sqrt(max(1, values.size // shape[0]))
    elif name.endswith("bias"):
        values *= 0.05
    else:
        values = 1 + 0.1 * values
    return torch.from_numpy(values.astype(np.float32))


@contextmanager
def undrawn() -> Iterator[None]:
    """Weights of layers made here are zero: to draw random ones takes seconds, and a test loads others."""
    linear, convolution = (
        patch.object(kind, "reset_parameters", clear) for kind in (nn.Linear, nn.modules.conv._ConvNd)
    )
    with linear, convolution:
        yield


@torch.no_grad()
def clear(layer: nn.Module) -> None:
    for parameter in layer.parameters(recurse=False):
        parameter.zero_()


@cache
def made_up_weights() -> dict[str, Tensor]:
    return {name: made_up_tensor(name, shape) for name, shape in SHAPES.items()}


def made_up_extractor(**settings) -> DepthSplatSmall:
    with undrawn():
        extractor = DepthSplatSmall(**settings)
    extractor.load_state_dict(made_up_weights())
    return extractor.eval().requires_grad_(False)
