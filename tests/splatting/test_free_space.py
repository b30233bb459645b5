"""The free-space check against a wall with a patch in front of it."""

import pytest
import torch
from torch import Tensor

from fecocodec.config import ReceiverConfig
from fecocodec.geometry.cameras import Cameras, camera_to_world_points, pixel_rays
from fecocodec.splatting.free_space import free_space_violation
from tests.example_scenes import cameras_in_a_row

SIDE = 32  # Gaussians a side
PATCH = (slice(12, 20), slice(12, 20))  # of the first view, seen by the second as well
RED, BLUE = torch.tensor([0.9, 0.1, 0.1]), torch.tensor([0.1, 0.1, 0.9])
WALL = 4.0
CONFIG = ReceiverConfig()


def cameras_side_by_side(apart: float = 0.5, scale: float = 1.0) -> Cameras:
    return cameras_in_a_row(0.0, apart * scale, near=scale, far=10.0 * scale).as_batch()


def judged(cameras: Cameras, patch_depth: float, patch_colour: Tensor, scale: float = 1.0) -> Tensor:
    """Return the violations of a patch that the first view has in front of or behind a blue wall seen by both views."""
    depth = torch.full((1, cameras.num_views, SIDE, SIDE), WALL)
    colour = BLUE.expand(1, cameras.num_views, SIDE, SIDE, 3).clone()
    depth[0, 0][PATCH], colour[0, 0][PATCH] = patch_depth, patch_colour
    depth = scale * depth
    means = camera_to_world_points(cameras, pixel_rays(cameras, SIDE, SIDE) * depth[..., None])
    return free_space_violation(means, depth, colour, torch.full_like(depth, 0.7), cameras, CONFIG)


def test_a_patch_of_another_colour_in_front_of_what_the_other_view_shows_is_contradicted() -> None:
    found = judged(cameras_side_by_side(), 2.5, RED)
    assert found[0, 0][PATCH].min() > 0.8
    found[0, 0][PATCH] = 0.0
    assert found.max() < 0.01


@pytest.mark.parametrize(
    ("depth", "colour"),
    [
        pytest.param(2.5, BLUE, id="like what is shown there"),
        pytest.param(8.0, RED, id="behind what is shown there"),
        pytest.param(WALL, RED, id="on what is shown there"),
    ],
)
def test_what_could_be_there_is_not_contradicted(depth: float, colour: Tensor) -> None:
    assert judged(cameras_side_by_side(), depth, colour)[0, 0].max() < 0.2


def test_views_that_see_nothing_of_it_contradict_nothing() -> None:
    assert judged(cameras_side_by_side(apart=100.0), 2.5, RED).max() == 0.0
    assert judged(cameras_side_by_side().select([0]), 2.5, RED).max() == 0.0
    cameras = cameras_side_by_side()
    cameras.extrinsics[0, 1, 2, 3] = 3.5  # the second camera is behind the patch
    assert judged(cameras, 2.5, RED)[0, 0][PATCH].max() == 0.0


def test_unit_and_order_do_not_matter() -> None:
    found = judged(cameras_side_by_side(), 2.5, RED)
    larger = judged(cameras_side_by_side(scale=50.0), 2.5, RED, scale=50.0)
    torch.testing.assert_close(larger, found, atol=1e-5, rtol=0.0)
    cameras = cameras_side_by_side()
    generator = torch.Generator().manual_seed(3)
    depth = 1.5 + 4.0 * torch.rand(1, 2, SIDE, SIDE, generator=generator)
    colour = torch.rand(1, 2, SIDE, SIDE, 3, generator=generator)
    opacity = torch.rand(1, 2, SIDE, SIDE, generator=generator)
    means = camera_to_world_points(cameras, pixel_rays(cameras, SIDE, SIDE) * depth[..., None])
    found = free_space_violation(means, depth, colour, opacity, cameras, CONFIG)
    turned = free_space_violation(
        means[:, [1, 0]], depth[:, [1, 0]], colour[:, [1, 0]], opacity[:, [1, 0]], cameras.select([1, 0]), CONFIG
    )
    torch.testing.assert_close(turned[:, [1, 0]], found)
    assert 0.05 < found.mean() < 0.95


def three_in_a_row() -> Cameras:
    return cameras_in_a_row(0.0, 0.5, 0.25, far=10.0).as_batch()


def walls_with_patches(cameras: Cameras, views_with_patch: list[int], patch: Tensor) -> Tensor:
    """Return violations when some views have a square of one colour at depth 2.5 and the others the wall behind it."""
    rays = pixel_rays(cameras, SIDE, SIDE)
    at_patch = camera_to_world_points(cameras, 2.5 * rays)[..., :2]
    is_patch = (at_patch.abs() < 0.4).all(dim=-1)
    is_patch &= torch.tensor([view in views_with_patch for view in range(cameras.num_views)])[:, None, None]
    depth = torch.where(is_patch, 2.5, WALL)
    colour = torch.where(is_patch[..., None], patch, BLUE)
    means = camera_to_world_points(cameras, rays * depth[..., None])
    found = free_space_violation(means, depth, colour, torch.full_like(depth, 0.7), cameras, CONFIG)
    return found[0, 0][is_patch[0, 0]]


def test_a_third_view_confirms_or_rejects() -> None:
    cameras = three_in_a_row()
    alone = walls_with_patches(cameras, [0], RED)
    confirmed = walls_with_patches(cameras, [0, 2], RED)
    assert alone.mean() > 0.8
    assert confirmed.mean() < alone.mean() - 0.1
    near_blue = BLUE + torch.tensor([0.12, 0.12, 0.0])
    pair = walls_with_patches(cameras.select([0, 1]), [0], near_blue)
    triple = walls_with_patches(cameras, [0], near_blue)
    assert triple.mean() > pair.mean() + 0.01
    cameras.extrinsics[0, 1, 2, 3] = 2.0  # the second camera is 0.5 in front of a patch at 2.5; the near bound is 1
    assert walls_with_patches(cameras, [0], BLUE).max() > 0.95
    cameras.extrinsics[0, 1, 2, 3] = 1.0
    assert walls_with_patches(cameras, [0], BLUE).max() < 0.2
