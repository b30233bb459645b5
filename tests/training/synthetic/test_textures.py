"""Textures: their mip levels, and where they come from.

Rays against solids, compared with points on a fine march along the ray.
"""

from pathlib import Path

import numpy as np
import pytest
import torch

from fecocodec.errors import InputError
from fecocodec.photographs.images import write_image
from fecocodec.training.synthetic.raycast import intersect
from fecocodec.training.synthetic.solids import BOX, CONE, CYLINDER, ELLIPSOID
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
    with pytest.raises(InputError, match="no images"):
        textures_from_folder(tmp_path)
    with pytest.raises(InputError, match="no photographs"):
        textures_from_photographs(tmp_path / "scene", num_crops=1)


STEPS = np.linspace(-6, 6, 24001)


def is_inside(kind: int, points: np.ndarray) -> np.ndarray:
    x, y, z = points.T
    if kind == BOX:
        return np.abs(points).max(-1) <= 1
    if kind == ELLIPSOID:
        return (points**2).sum(-1) <= 1
    radius = 1.0 if kind == CYLINDER else (y + 1) / 2
    return (np.abs(y) <= 1) & (np.hypot(x, z) <= radius)


@pytest.mark.parametrize("kind", [BOX, ELLIPSOID, CYLINDER, CONE])
def test_interval_is_where_the_ray_is_inside(kind: int) -> None:
    rng = np.random.default_rng(kind)
    num_hits = 0
    for _ in range(120):
        origin = rng.normal(0, 1.2, 3)
        direction = rng.normal(0, 1, 3)
        direction /= np.linalg.norm(direction)
        start, end = intersect(float(kind), *origin, *direction)
        inside = is_inside(kind, origin + STEPS[:, None] * direction)
        if inside.sum() < 2:
            assert end - start < 2e-3
            continue
        num_hits += 1
        assert start == pytest.approx(STEPS[inside][0], abs=1e-3)
        assert end == pytest.approx(STEPS[inside][-1], abs=1e-3)
    assert num_hits >= 15
