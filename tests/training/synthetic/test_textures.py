"""Textures: their mip levels, and where they come from."""

from pathlib import Path

import numpy as np
import pytest
import torch

from fecocodec.errors import InputError
from fecocodec.photographs.images import write_image
from fecocodec.training.synthetic.textures import (
    TEXTURE_SIDE,
    pattern_textures,
    pyramid_of,
    textures_from_folder,
    textures_from_photographs,
)


def test_every_mip_level_keeps_the_mean_colour() -> None:
    image = np.random.default_rng(0).integers(0, 256, (1, TEXTURE_SIDE, TEXTURE_SIDE, 3), dtype=np.uint8)
    texels = pyramid_of(image).texels[0].astype(float)
    mean = image.reshape(-1, 3).mean(0)
    start, side = 0, TEXTURE_SIDE
    while side >= 1:
        level = texels[start : start + side * side]
        np.testing.assert_allclose(level.mean(0), mean, atol=0.6)
        start, side = start + side * side, side // 2
    assert start == len(texels)


def test_patterns_differ_from_each_other_and_repeat_for_a_seed() -> None:
    first, again = pattern_textures(26, seed=1), pattern_textures(26, seed=1)
    assert np.array_equal(first.texels, again.texels)
    assert len(np.unique(first.texels.reshape(26, -1), axis=0)) == 26


def test_folders_and_photographs_become_textures(tmp_path: Path) -> None:
    (tmp_path / "scene" / "images").mkdir(parents=True)
    write_image(tmp_path / "scene" / "images" / "a.png", torch.full((3, 60, 90), 0.5))
    single = textures_from_folder(tmp_path / "scene" / "images")
    crops = textures_from_photographs(tmp_path, num_crops=3)
    assert len(single) == 1 and len(single + crops) == 4
    assert np.all(np.abs((single + crops).texels.astype(int) - 128) <= 1)


def test_an_empty_folder_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no images"):
        textures_from_folder(tmp_path)
    with pytest.raises(InputError, match="no photographs"):
        textures_from_photographs(tmp_path, num_crops=1)
