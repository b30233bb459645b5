"""Padding of views to sides that the networks can halve five times."""

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras

MULTIPLE = 32


def padded_size(height: int, width: int) -> tuple[int, int]:
    """Both sides rounded up to a multiple of 32."""
    return -(-height // MULTIPLE) * MULTIPLE, -(-width // MULTIPLE) * MULTIPLE


def pad_images(images: Float[Tensor, "view 3 height width"]) -> Float[Tensor, "view 3 padded_h padded_w"]:
    """Repeat the last row and column downwards and to the right."""
    height, width = images.shape[-2:]
    padded_height, padded_width = padded_size(height, width)
    return F.pad(images, (0, padded_width - width, 0, padded_height - height), mode="replicate")


def pad_cameras(cameras: Cameras, height: int, width: int) -> Cameras:
    """Cameras of the padded images: the same rays, normalised by the padded size."""
    padded_height, padded_width = padded_size(height, width)
    scale = cameras.intrinsics.new_tensor([width / padded_width, height / padded_height, 1.0])
    return Cameras(cameras.extrinsics, cameras.intrinsics * scale[:, None], cameras.near, cameras.far)


def inside_unpadded(num_views: int, height: int, width: int) -> Bool[Tensor, " n"]:
    """Which Gaussians of the padded views' 1/2 grids, ordered (view, row, column), stand for pixels of the image."""
    padded_height, padded_width = padded_size(height, width)
    rows = 2 * torch.arange(padded_height // 2) < height
    columns = 2 * torch.arange(padded_width // 2) < width
    return (rows[:, None] & columns).flatten().repeat(num_views)
