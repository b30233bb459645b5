"""Texture pyramids that procedural worlds are painted with."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray
from PIL import Image

from fecocodec.errors import InputError
from fecocodec.training.patterns import draw_patterns

TEXTURE_SIDE = 128
"""Texels along a side at the finest level; halved level by level down to one texel."""


@dataclass(frozen=True)
class Textures:
    """Square sRGB textures with all their mip levels, finest first, flattened one after the other."""

    texels: UInt8[ndarray, "texture texel 3"]

    def __len__(self) -> int:
        return len(self.texels)

    def __add__(self, other: "Textures") -> "Textures":
        return Textures(np.concatenate((self.texels, other.texels)))


def pyramid_of(images: UInt8[ndarray, "texture side side 3"]) -> Textures:
    """Build the mip levels by averaging 2x2 texels."""
    level = images.astype(np.float32)
    levels = [images.reshape(len(images), -1, 3)]
    while level.shape[1] > 1:
        level = (level[:, ::2, ::2] + level[:, 1::2, ::2] + level[:, ::2, 1::2] + level[:, 1::2, 1::2]) / 4
        levels.append(np.round(level).astype(np.uint8).reshape(len(images), -1, 3))
    return Textures(np.concatenate(levels, axis=1))


def pattern_textures(num_textures: int, seed: int = 0) -> Textures:
    """Textures made by code alone (noise, bricks, boards, writing, ...); the same for the same seed."""
    return pyramid_of(draw_patterns(np.random.default_rng(seed), num_textures, TEXTURE_SIDE))


def textures_from_folder(folder: Path) -> Textures:
    """Every WebP, PNG or JPEG of a folder, its middle square scaled to the texture size."""
    images = [_square(image, min(image.size)) for image in _open_images(folder)]
    return pyramid_of(np.stack(images))


def textures_from_photographs(folder: Path, num_crops: int, seed: int = 0) -> Textures:
    """Random square crops of the photographs below a folder (`*/images/*`); the same for the same seed."""
    rng = np.random.default_rng(seed)
    paths = sorted(path for path in folder.glob("*/images/*") if path.suffix.lower() in (".jpg", ".jpeg", ".png"))
    if not paths:
        raise InputError(f"{folder}: no photographs in */images; give the folder that holds the training scenes.")
    return pyramid_of(np.stack([_random_crop(paths[rng.integers(len(paths))], rng) for _ in range(num_crops)]))


def _open_images(folder: Path) -> list[Image.Image]:
    paths = sorted(path for path in folder.iterdir() if path.suffix.lower() in (".webp", ".png", ".jpg", ".jpeg"))
    if not paths:
        raise InputError(f"{folder}: no WebP, PNG or JPEG textures; give a folder that holds some.")
    return [Image.open(path).convert("RGB") for path in paths]


def _square(image: Image.Image, side: int, left_top: tuple[int, int] | None = None) -> UInt8[ndarray, "side side 3"]:
    left, top = left_top or ((image.width - side) // 2, (image.height - side) // 2)
    crop = image.crop((left, top, left + side, top + side))
    return np.asarray(crop.resize((TEXTURE_SIDE, TEXTURE_SIDE), Image.Resampling.LANCZOS))


def _random_crop(path: Path, rng: np.random.Generator) -> UInt8[ndarray, "side side 3"]:
    image = Image.open(path).convert("RGB")
    side = int(rng.integers(min(image.size) // 3, min(image.size) + 1))
    corner = (int(rng.integers(image.width - side + 1)), int(rng.integers(image.height - side + 1)))
    return _square(image, side, corner)
