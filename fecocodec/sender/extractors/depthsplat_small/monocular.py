"""The monocular branch: features of DINOv2's ViT-S/14, as Depth Anything V2 uses it, at 1/4 resolution."""

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from fecocodec.grid import FEATURES
from fecocodec.sender.extractors.vision_transformer import PATCH, VisionTransformer


def monocular_features(
    network: VisionTransformer, images: Float[Tensor, "item 3 h w"]
) -> Float[Tensor, "item channel h4 w4"]:
    """Return monocular features of each view at 1/4 resolution.

    images: normalised by the ImageNet mean and standard deviation. They are resized down to whole patches; the features
    are resized to 1/8, then to 1/4 resolution.
    """
    h, w = images.shape[-2:]
    whole = _resize(images, (h // PATCH * PATCH, w // PATCH * PATCH))
    return _resize(_resize(network(whole), (h // 8, w // 8)), (h // FEATURES, w // FEATURES))


def _resize(x: Float[Tensor, "item _ _ _"], size: tuple[int, int]) -> Float[Tensor, "item _ _ _"]:
    return F.interpolate(x, size, mode="bilinear", align_corners=True)
