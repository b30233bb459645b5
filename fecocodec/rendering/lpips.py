"""LPIPS v0.1, a differentiable perceptual distance of images, with VGG16 and with AlexNet.

Zhang et al., "The Unreasonable Effectiveness of Deep Features as a Perceptual Metric", CVPR 2018. Weights are in
`weights/lpips`; the file of VGG16 has int8 weights, and is in a clone only: wheels leave it out.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.checkpoint import SHIPPED, load_into, read_tensors
from fecocodec.errors import ModelError
from fecocodec.rendering.metrics import require_sides
from fecocodec.rendering.perceptual import (
    PictureBatch,
    Pictures,
    distance_of_features,
    distances_of_pairs,
    normalised,
)

LPIPS_WEIGHTS = SHIPPED / "lpips"


@dataclass(frozen=True)
class Trunk:
    """Convolutions of a trunk, each followed by a ReLU.

    channels: of the output, by convolution. kernels: (side, stride, padding) of the first ones; the others have the
    last. pooled: convolutions before which a max pooling with side `pool` and stride 2 stands. compared: convolutions
    whose features are compared. least_side: of an image, in pixels.
    """

    title: str
    file: str
    channels: tuple[int, ...]
    kernels: tuple[tuple[int, int, int], ...]
    pool: int
    pooled: tuple[int, ...]
    compared: tuple[int, ...]
    least_side: int


TRUNKS: Mapping[str, Trunk] = MappingProxyType(
    {
        "vgg16": Trunk(
            title="LPIPS (VGG16)",
            file="lpips_vgg16.safetensors",
            channels=(64, 64, 128, 128, *(256,) * 3, *(512,) * 6),
            kernels=((3, 1, 1),),
            pool=2,
            pooled=(2, 4, 7, 10),
            compared=(1, 3, 6, 9, 12),
            least_side=16,
        ),
        "alexnet": Trunk(
            title="LPIPS (AlexNet)",
            file="lpips_alexnet.safetensors",
            channels=(64, 192, 384, 256, 256),
            kernels=((11, 4, 2), (5, 1, 2), (3, 1, 1)),
            pool=3,
            pooled=(1, 2),
            compared=(0, 1, 2, 3, 4),
            least_side=31,
        ),
    }
)


class Lpips(nn.Module):
    """image -> five layers of a trunk -> unit features -> squared difference -> weighted sum over channels -> mean."""

    def __init__(self, trunk: Trunk) -> None:
        super().__init__()
        self.trunk = trunk
        before = 3
        for number, after in enumerate(trunk.channels):
            side, stride, padding = trunk.kernels[min(number, len(trunk.kernels) - 1)]
            self.add_module(f"conv{number}", nn.Conv2d(before, after, side, stride, padding))
            before = after
        for layer, number in enumerate(trunk.compared):
            self.add_module(f"linear{layer}", nn.Conv2d(trunk.channels[number], 1, 1, bias=False))

    def forward(self, images: Pictures, targets: Pictures) -> Float[Tensor, " image"]:
        """Return the distance of each pair. images, targets: sRGB in [0, 1]."""
        distance = images.new_zeros(len(images))
        x = normalised(torch.cat((images, targets)))
        for number in range(len(self.trunk.channels)):
            if number in self.trunk.pooled:
                x = F.max_pool2d(x, self.trunk.pool, stride=2)
            x = F.relu(self.get_submodule(f"conv{number}")(x))
            if number in self.trunk.compared:
                weights = self.get_submodule(f"linear{self.trunk.compared.index(number)}")
                distance = distance + distance_of_features(x, weights)
        return distance


def is_lpips_there(trunk: str, folder: Path = LPIPS_WEIGHTS) -> bool:
    """Return whether the weights of a trunk, a key of TRUNKS, are installed."""
    return (folder / TRUNKS[trunk].file).is_file()


def require_lpips(trunk: str, folder: Path = LPIPS_WEIGHTS) -> Path:
    """Return the weights file of a trunk, a key of TRUNKS. Raises ModelError if it is not installed."""
    if not is_lpips_there(trunk, folder):
        raise ModelError(
            f"{folder / TRUNKS[trunk].file}: {TRUNKS[trunk].title} needs this file, which wheels leave out; install "
            "from a clone, or choose ST-LPIPS."
        )
    return folder / TRUNKS[trunk].file


@lru_cache(maxsize=4)
@torch.inference_mode(False)
def load_lpips(trunk: str, device: str = "cpu", folder: Path = LPIPS_WEIGHTS) -> Lpips:
    """Return the network of a trunk on a device, frozen. Raises ModelError if its weights are missing or damaged."""
    path = require_lpips(trunk, folder)
    network = Lpips(TRUNKS[trunk])
    load_into(network, _scaled(read_tensors(path)), path)
    return network.eval().requires_grad_(False).to(device)


def lpips_vgg(images: PictureBatch, targets: PictureBatch) -> Float[Tensor, "*batch"]:
    """Return the LPIPS (VGG16) of each pair, 0 for equal images. images, targets: sRGB in [0, 1].

    Gradients reach the images. Raises InputError if a side is shorter than 16 pixels, ModelError without its weights.
    """
    return _distances("vgg16", images, targets)


def lpips_alex(images: PictureBatch, targets: PictureBatch) -> Float[Tensor, "*batch"]:
    """Return the LPIPS (AlexNet) of each pair. As `lpips_vgg`; sides have at least 31 pixels."""
    return _distances("alexnet", images, targets)


def _distances(trunk: str, images: Tensor, targets: Tensor) -> Tensor:
    require_sides(images, TRUNKS[trunk].least_side, TRUNKS[trunk].title)
    return distances_of_pairs(load_lpips(trunk, str(images.device)), images, targets)


def _scaled(tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """Return weights in float32: those in int8 are multiplied by `convN.scale`, one factor per output channel."""
    scales = {name.removesuffix("scale"): value for name, value in tensors.items() if name.endswith(".scale")}
    found = {name: value for name, value in tensors.items() if not name.endswith(".scale")}
    return found | {f"{of}weight": found[f"{of}weight"] * scale[:, None, None, None] for of, scale in scales.items()}
