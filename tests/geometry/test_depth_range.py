"""Estimation of near and far from images, on a scene of known depth."""

import math

import numpy as np
import pytest
import torch
import torch.nn.functional as F

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.depth_bounds import bounds_of_depths
from fecocodec.geometry.depth_range import DEFAULT_RANGE, MOST_BEFORE, believable_bounds, estimate_depth_range
from fecocodec.geometry.views import Views
from tests.example_scenes import cameras_in_a_row

NEAR_WALL, FAR_WALL = 2.0, 8.0
HEIGHT, WIDTH, FOCAL_PX = 96, 128, 110.0


def two_walls(positions: list[float], unit: float = 1.0) -> Views:
    """A near wall fills the lower half of each image and a far wall the upper half; cameras move to the right."""
    generator = torch.Generator().manual_seed(0)
    texture = F.interpolate(torch.rand(1, 3, 64, 160, generator=generator), scale_factor=4, mode="bicubic").clamp(0, 1)
    v, u = torch.meshgrid(torch.arange(HEIGHT) + 0.5, torch.arange(WIDTH) + 0.5, indexing="ij")
    depth = torch.where(v > HEIGHT / 2, NEAR_WALL, FAR_WALL)
    images = []
    for position in positions:
        column = u + FOCAL_PX * position / depth + 200  # of the texture, rendered at one texel per pixel
        grid = torch.stack((2 * column / texture.shape[-1] - 1, 2 * v / texture.shape[-2] - 1), dim=-1)
        images.append(F.grid_sample(texture, grid[None], align_corners=False)[0])
    focal = (FOCAL_PX / WIDTH, FOCAL_PX / HEIGHT)
    cameras = cameras_in_a_row(*(unit * x for x in positions), focal=focal, near=math.nan, far=math.nan)
    return Views(torch.stack(images), cameras, tuple(map(str, positions)))


@pytest.mark.parametrize("positions", [[0.0, 0.3], [0.0, 0.5, 0.2], [0.0, -0.25, 0.25, 0.5]])
def test_bounds_enclose_the_scene_closely(positions):
    near, far = estimate_depth_range(two_walls(positions))
    assert NEAR_WALL / 2 < near < NEAR_WALL
    assert FAR_WALL < far < FAR_WALL * 2


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_bounds_follow_the_unit_of_length(unit):
    near, far = estimate_depth_range(two_walls([0.0, 0.3]))
    assert estimate_depth_range(two_walls([0.0, 0.3], unit)) == pytest.approx((near * unit, far * unit), rel=0.05)


@pytest.mark.parametrize("positions", [[0.0], [0.0, 0.0]])
def test_without_a_baseline_the_default_holds(positions):
    assert estimate_depth_range(two_walls(positions)) == DEFAULT_RANGE


def test_where_nothing_matches_the_default_is_in_baselines_and_bounds_are_believed():
    views = two_walls([0.0, 0.5])
    blank = Views(torch.full_like(views.images, 0.5), views.cameras, views.names)
    assert estimate_depth_range(blank) == pytest.approx((0.5 * DEFAULT_RANGE[0], 0.5 * DEFAULT_RANGE[1]))
    assert believable_bounds(blank.within(0.04, 0.16)) is None


def test_views_that_face_away_from_each_other_give_a_usable_range():
    views = two_walls([0.0, 0.5])
    extrinsics = views.cameras.extrinsics.clone()
    extrinsics[1, :3, :3] = torch.diag(torch.tensor([-1.0, 1.0, -1.0]))
    cameras = Cameras(extrinsics, views.cameras.intrinsics, views.cameras.near, views.cameras.far)
    near, far = estimate_depth_range(Views(views.images, cameras, views.names))
    assert 0 < near < far < math.inf


def test_bounds_of_depths():
    depths = torch.linspace(1, 2, 10_001)
    assert bounds_of_depths(depths.numpy()) == pytest.approx((1.01 / 1.15, 1.99 * 1.15))
    depths = torch.cat((torch.full((900,), 3.0), torch.full((100,), 1e6)))
    assert bounds_of_depths(depths.numpy()) == pytest.approx((3 / 1.15, 40.0))
    assert bounds_of_depths(np.ones(49)) is None
    assert bounds_of_depths(np.full(60, np.inf)) is bounds_of_depths(np.zeros(0)) is None
    depths = np.linspace(2.0, 5.0, 200)
    for absurd in (np.inf, 1e300, 1e12):  # does not count
        assert bounds_of_depths(np.append(depths, np.full(60, absurd))) == bounds_of_depths(depths)


@pytest.mark.parametrize("bounds", [(1.2, 10.0), (NEAR_WALL, FAR_WALL), (1.0, 1000.0)])
def test_bounds_that_fit_are_believed(bounds):
    assert believable_bounds(two_walls([0.0, 0.3]).within(*bounds)) is None


def test_bounds_beyond_the_scene_are_estimated_and_a_near_far_before_it_is_moved():
    views = two_walls([0.0, 0.3])
    estimate = estimate_depth_range(views)
    for bounds in ((40.0, 160.0), (0.04, 0.16)):
        assert believable_bounds(views.within(*bounds)) == estimate
    nearest = estimate[0] / MOST_BEFORE
    assert believable_bounds(views.within(0.2, 80.0)) == (nearest, 80.0)
    assert believable_bounds(views.within(nearest, 80.0)) is None
