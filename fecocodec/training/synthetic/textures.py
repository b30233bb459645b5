"""Texture pyramids of synthetic worlds."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float, UInt8
from numpy import ndarray
from torch import Tensor

from fecocodec.errors import InputError
from fecocodec.photographs.image_headers import has_image_name
from fecocodec.photographs.images import read_image
from fecocodec.training.synthetic.patterns import draw_patterns

TEXTURE_SIDE = 128
"""Texels along a side at the finest level; halved level by level down to one texel."""


@dataclass(frozen=True)
class Textures:
    """Square sRGB textures with all mip levels, finest first, flattened and concatenated."""

    texels: UInt8[ndarray, "texture texel 3"]

    def __len__(self) -> int:
        return len(self.texels)

    def __add__(self, other: "Textures") -> "Textures":
        return Textures(np.concatenate((self.texels, other.texels)))


def pyramid_of(images: UInt8[ndarray, "texture side side 3"]) -> Textures:
    """Build the mip levels by averaging 2x2 texels."""
    level: ndarray = images.astype(np.float32)
    levels = [images.reshape(len(images), -1, 3)]
    while level.shape[1] > 1:
        level = (level[:, ::2, ::2] + level[:, 1::2, ::2] + level[:, ::2, 1::2] + level[:, 1::2, 1::2]) / 4
        levels.append(np.round(level).astype(np.uint8).reshape(len(images), -1, 3))
    return Textures(np.concatenate(levels, axis=1))


def pattern_textures(num_textures: int, seed: int = 0) -> Textures:
    """Draw textures of noise, bricks, boards, writing and others. Equal seeds give equal textures."""
    return pyramid_of(draw_patterns(np.random.default_rng(seed), num_textures, TEXTURE_SIDE))


def textures_from_folder(folder: Path) -> Textures:
    """Scale the middle square of each image of a folder to the texture size. Raises InputError without an image."""
    paths = sorted(path for path in folder.glob("*") if has_image_name(path))
    if not paths:
        raise InputError(f"{folder}: no images to use as textures; give a folder that holds some.")
    return pyramid_of(np.stack([_middle_square(read_image(path)) for path in paths]))


def textures_from_photographs(folder: Path, num_crops: int, seed: int = 0) -> Textures:
    """Draw square crops of `*/images/*` below a folder, equal for equal seeds. Raises InputError without any."""
    rng = np.random.default_rng(seed)
    paths = sorted(path for path in folder.glob("*/images/*") if has_image_name(path))
    if not paths:
        raise InputError(f"{folder}: no photographs in */images; give the folder that holds the training scenes.")
    return pyramid_of(
        np.stack([_random_square(read_image(paths[rng.integers(len(paths))]), rng) for _ in range(num_crops)])
    )


def _middle_square(image: Float[Tensor, "3 height width"]) -> UInt8[ndarray, "side side 3"]:
    side = min(image.shape[1:])
    return _square(image, (image.shape[1] - side) // 2, (image.shape[2] - side) // 2, side)


def _random_square(image: Float[Tensor, "3 height width"], rng: np.random.Generator) -> UInt8[ndarray, "side side 3"]:
    most = min(image.shape[1:])
    side = int(rng.integers(most // 3, most + 1))
    top, left = int(rng.integers(image.shape[1] - side + 1)), int(rng.integers(image.shape[2] - side + 1))
    return _square(image, top, left, side)


def _square(image: Float[Tensor, "3 height width"], top: int, left: int, side: int) -> UInt8[ndarray, "side side 3"]:
    window = image[None, :, top : top + side, left : left + side]
    scaled = F.interpolate(window, (TEXTURE_SIDE, TEXTURE_SIDE), mode="bicubic", antialias=True, align_corners=False)
    texels: ndarray = rearrange((scaled[0].clamp(0, 1) * 255).round().byte(), "rgb h w -> h w rgb").numpy()
    return texels
