"""The per-view CNN: residual blocks with instance normalisation, from full to 1/4 resolution."""

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from fecocodec.grid import FEATURES
from fecocodec.sender.extractors.vision_transformer import PATCH, Pictures, VisionTransformer

STEM, MIDDLE, OUTPUT = 64, 96, 128  # channels


class ResidualBlock(nn.Module):
    """x -> two (3x3 conv, instance norm, ReLU) -> + shortcut -> ReLU."""

    def __init__(self, in_channels: int, out_channels: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(in_channels, out_channels, 3, stride, padding=1, bias=False)
        self.conv2 = nn.Conv2d(out_channels, out_channels, 3, padding=1, bias=False)
        self.downsample = None
        if stride != 1 or in_channels != out_channels:
            self.downsample = nn.Sequential(
                nn.Conv2d(in_channels, out_channels, 1, stride), nn.InstanceNorm2d(out_channels)
            )

    def forward(self, x: Float[Tensor, "item _ _ _"]) -> Float[Tensor, "item _ _ _"]:
        residual = F.relu(F.instance_norm(self.conv1(x)))
        residual = F.relu(F.instance_norm(self.conv2(residual)))
        shortcut = x if self.downsample is None else self.downsample(x)
        return F.relu(shortcut + residual)


class Backbone(nn.Module):
    """image -> 7x7 conv (1/2) -> two blocks of 64, two of 96 (stride), two of 128 channels (half) -> 1x1 conv."""

    def __init__(self, middle_stride: int = 1) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(3, STEM, 7, stride=2, padding=3, bias=False)
        self.layer1 = _two_blocks(STEM, STEM, stride=1)
        self.layer2 = _two_blocks(STEM, MIDDLE, middle_stride)
        self.layer3 = _two_blocks(MIDDLE, OUTPUT, stride=2)
        self.conv2 = nn.Conv2d(OUTPUT, OUTPUT, 1)
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")

    def forward(self, images: Pictures) -> Float[Tensor, "item 128 h4 w4"]:
        """Return features at 1/4 resolution. images: normalised by the ImageNet mean and standard deviation."""
        return self.scales(images)[-1]

    def scales(self, images: Pictures) -> tuple[Tensor, Tensor, Tensor]:
        """Return the features of all three stages, of 64, 96 and 128 channels; the last are those of `forward`."""
        stem = self.layer1(F.relu(F.instance_norm(self.conv1(images))))
        middle = self.layer2(stem)
        return stem, middle, self.conv2(self.layer3(middle))


def _two_blocks(in_channels: int, out_channels: int, stride: int) -> nn.Sequential:
    return nn.Sequential(ResidualBlock(in_channels, out_channels, stride), ResidualBlock(out_channels, out_channels, 1))


def monocular_features(network: VisionTransformer, images: Pictures) -> Float[Tensor, "item channel h4 w4"]:
    """Return monocular features of each view at 1/4 resolution.

    images: normalised by the ImageNet mean and standard deviation. They are resized down to whole patches; the features
    are resized to 1/8, then to 1/4 resolution.
    """
    h, w = images.shape[-2:]
    return resized(resized(network(whole_patches(images)), (h // 8, w // 8)), (h // FEATURES, w // FEATURES))


def whole_patches(images: Pictures) -> Float[Tensor, "item 3 _ _"]:
    """Resize images down to whole patches."""
    h, w = images.shape[-2:]
    return resized(images, (h // PATCH * PATCH, w // PATCH * PATCH))


def resized(x: Float[Tensor, "item _ _ _"], size: tuple[int, ...]) -> Float[Tensor, "item _ _ _"]:
    """Resize maps bilinearly, with their corners aligned."""
    return F.interpolate(x, size, mode="bilinear", align_corners=True)
