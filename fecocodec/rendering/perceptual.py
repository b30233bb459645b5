"""ST-LPIPS, a differentiable perceptual distance of images.

Ghildyal and Liu, "Shift-tolerant Perceptual Similarity Metric", ECCV 2022. It is LPIPS on an AlexNet whose strided
convolutions and poolings are replaced by dense ones, each followed by a blur of stride 2. Its values are not those of
LPIPS (see `rendering/lpips.py`).
"""

from functools import lru_cache

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.checkpoint import SHIPPED, load_into, read_tensors
from fecocodec.rendering.metrics import require_sides

ST_LPIPS_WEIGHTS = SHIPPED / "stlpips_alex" / "stlpips_alex.safetensors"
ST_LPIPS_LEAST_SIDE = 21  # pixels; below it, the last blur has fewer than three rows to reflect
_SHIFT, _SCALE = (-0.030, -0.088, -0.188), (0.458, 0.448, 0.450)
_CHANNELS = (3, 64, 192, 384, 256, 256)
_KERNELS_AND_PADDINGS = ((11, 2), (5, 2), (3, 1), (3, 1), (3, 1))
_POOLED_SLICES = (2, 3)
_EPSILON = 1e-10  # added to the norm of a feature vector
Pictures = Float[Tensor, "image 3 height width"]
PictureBatch = Float[Tensor, "*batch 3 height width"]


class StLpips(nn.Module):
    """image -> five slices of AlexNet -> unit features -> squared difference -> weighted sum over channels -> mean.

    Slices 1 to 3 halve the resolution by a blur; slices 2 and 3 begin with a max pooling.
    """

    def __init__(self) -> None:
        super().__init__()
        for number, (kernel, padding) in enumerate(_KERNELS_AND_PADDINGS, start=1):
            before, after = _CHANNELS[number - 1], _CHANNELS[number]
            self.add_module(f"conv{number}", nn.Conv2d(before, after, kernel, padding=padding))
            self.add_module(f"linear{number}", nn.Conv2d(after, 1, 1, bias=False))

    def forward(self, images: Pictures, targets: Pictures) -> Float[Tensor, " image"]:
        """Return the distance of each pair. images, targets: sRGB in [0, 1]."""
        distance = images.new_zeros(len(images))
        x = normalised(torch.cat((images, targets)))
        for number in range(1, len(_KERNELS_AND_PADDINGS) + 1):
            x = self._slice(number, x)
            distance = distance + distance_of_features(x, self.get_submodule(f"linear{number}"))
        return distance

    def _slice(self, number: int, x: Float[Tensor, "image _ _ _"]) -> Float[Tensor, "image _ _ _"]:
        """Apply one slice. The blur of a slice precedes the ReLU in slice 1 and the convolution in slices 2 and 3."""
        if number in _POOLED_SLICES:
            x = _blurred(F.max_pool2d(x, 3, stride=1))
        x = self.get_submodule(f"conv{number}")(x)
        return F.relu(_blurred(x) if number == 1 else x)


@lru_cache(maxsize=2)
@torch.inference_mode(False)
def load_st_lpips(device: str = "cpu") -> StLpips:
    """Return the shipped network on a device, frozen. Raises ModelError if its weights are missing or damaged."""
    network = StLpips()
    load_into(network, read_tensors(ST_LPIPS_WEIGHTS), ST_LPIPS_WEIGHTS)
    return network.eval().requires_grad_(False).to(device)


def st_lpips(images: PictureBatch, targets: PictureBatch) -> Float[Tensor, "*batch"]:
    """Return the ST-LPIPS (AlexNet) of each pair, 0 for equal images. images, targets: sRGB in [0, 1].

    Gradients reach the images. Raises InputError if a side is shorter than 21 pixels.
    """
    require_sides(images, ST_LPIPS_LEAST_SIDE, "ST-LPIPS")
    return distances_of_pairs(load_st_lpips(str(images.device)), images, targets)


def distances_of_pairs(network: nn.Module, images: PictureBatch, targets: PictureBatch) -> Float[Tensor, "*batch"]:
    """Return what a network of pairs returns for images with any batch dimensions."""
    distances: Tensor = network(*(stack.reshape(-1, *stack.shape[-3:]) for stack in (images, targets)))
    return distances.reshape(images.shape[:-3])


def normalised(images: Pictures) -> Pictures:
    """Return images, sRGB in [0, 1], as LPIPS and ST-LPIPS expect them."""
    shift, scale = (images.new_tensor(values)[:, None, None] for values in (_SHIFT, _SCALE))
    return (2.0 * images - 1.0 - shift) / scale


def distance_of_features(x: Float[Tensor, "both channel _ _"], weights: nn.Module) -> Float[Tensor, " image"]:
    """Return the weighted squared difference of unit features, mean over positions. both: images, then targets.

    Gradients are finite for features that are all 0.
    """
    norm = x.square().sum(dim=1, keepdim=True).clamp_min(torch.finfo(x.dtype).tiny).sqrt()
    images, targets = (x / (norm + _EPSILON)).chunk(2)
    distances: Tensor = weights((images - targets).square()).mean(dim=(1, 2, 3))
    return distances


def _blurred(x: Float[Tensor, "image channel _ _"]) -> Float[Tensor, "image channel _ _"]:
    """Pad by reflection, then apply the kernel (1 2 1)x(1 2 1)/16 with stride 2 to each channel."""
    padded = F.pad(x, (2, 2, 2, 2), mode="reflect")
    line = x.new_tensor([0.25, 0.5, 0.25])
    channels = x.shape[1]
    vertical = F.conv2d(padded, line.view(1, 1, 3, 1).expand(channels, 1, 3, 1), stride=(2, 1), groups=channels)
    return F.conv2d(vertical, line.view(1, 1, 1, 3).expand(channels, 1, 1, 3), stride=(1, 2), groups=channels)
