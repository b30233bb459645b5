"""The background layer fills areas outside the context views and does not change renderings at these views."""

from dataclasses import replace

import pytest
import torch
from einops import rearrange

from fecocodec.geometry.cameras import Cameras, camera_to_world_points, pixel_rays
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.rendering.rasterizer import Rendering, render
from fecocodec.splatting.background import append, background_layer
from tests.example_scenes import cameras_in_a_row, surface

SIDE = 32  # Gaussians along a side
IMAGE = (192, 192)
WALL = 4.0
GREY, RED = torch.tensor([0.6, 0.6, 0.6]), torch.tensor([0.9, 0.1, 0.1])


def turned_about_y(cameras: Cameras, angles: torch.Tensor) -> Cameras:
    """Turn each camera by an angle in radians."""
    extrinsics = cameras.extrinsics.clone()
    extrinsics[:, 0, 0], extrinsics[:, 0, 2] = angles.cos(), angles.sin()
    extrinsics[:, 2, 0], extrinsics[:, 2, 2] = -angles.sin(), angles.cos()
    return replace(cameras, extrinsics=extrinsics)


def wall(cameras: Cameras, opacity: float = 0.9) -> Gaussians:
    """Return a grey surface at constant depth in each view, red in the rightmost quarter."""
    colour = GREY.repeat(cameras.num_views, SIDE, SIDE, 1)
    colour[:, :, 3 * SIDE // 4 :] = RED
    return surface(cameras, torch.full((cameras.num_views, SIDE, SIDE), WALL), colour, opacity)


def rendered(gaussians: Gaussians, cameras: Cameras) -> Rendering:
    return render(gaussians, cameras, IMAGE)


@pytest.mark.parametrize("opacity", [0.9, 0.5])
def test_the_pictures_at_the_context_cameras_do_not_change(opacity: float) -> None:
    cameras = turned_about_y(cameras_in_a_row(-0.5, 0.5), torch.tensor([0.2, -0.2]))
    scene = wall(cameras, opacity)
    before = rendered(scene, cameras)
    after = rendered(append(scene, background_layer(scene, cameras, (SIDE, SIDE))), cameras)
    assert float((after.color - before.color).square().mean()) < 1e-5  # 50 dB


def test_a_view_from_beside_has_no_holes() -> None:
    cameras, beside = cameras_in_a_row(-0.5, 0.5), cameras_in_a_row(-2.5, 2.5)
    scene = wall(cameras)
    before = rendered(scene, beside).alpha < 0.5
    after = rendered(append(scene, background_layer(scene, cameras, (SIDE, SIDE))), beside).alpha < 0.5
    assert float(before.float().mean()) > 0.2
    assert float(after.float().mean()) < 0.2 * float(before.float().mean())


def test_the_colour_of_the_near_border_is_continued() -> None:
    cameras, beside = cameras_in_a_row(0.0), cameras_in_a_row(-3.0, 3.0)
    scene = wall(cameras)
    left, right = rendered(append(scene, background_layer(scene, cameras, (SIDE, SIDE))), beside).color[..., 96, :]
    torch.testing.assert_close(left[:, 24], GREY, atol=0.1, rtol=0.0)
    torch.testing.assert_close(right[:, -24], RED, atol=0.1, rtol=0.0)


def test_where_the_layer_stands() -> None:
    cameras = cameras_in_a_row(0.0)
    scene = wall(cameras)
    layer = background_layer(scene, cameras, (SIDE, SIDE))
    assert float(layer.means[:, 2].min()) > 1.05 * WALL
    with_slopes = replace(scene, harmonics=torch.cat((scene.harmonics, torch.ones(scene.count, 3, 3)), dim=1))
    joined = append(with_slopes, layer)
    assert joined.count == scene.count + layer.count
    assert torch.equal(joined.harmonics[scene.count :, :1], layer.harmonics)
    assert float(joined.harmonics[scene.count :, 1:].abs().max()) == 0.0
    opacities = scene.opacities.clone().view(SIDE, SIDE)
    opacities[:, :24], opacities[:4], opacities[-4:] = 0.0, 0.0, 0.0
    layer = background_layer(replace(scene, opacities=opacities.flatten()), cameras, (SIDE, SIDE))
    assert layer.count > 0
    assert float((layer.means[:, 0] / layer.means[:, 2]).min()) > 0.0
    cameras = cameras_in_a_row(-0.5, 0.5)
    scene = wall(cameras)
    scene.means[5] = torch.inf
    layer = background_layer(scene, cameras, (SIDE, SIDE))
    assert layer.count > 0
    assert all(bool(field.isfinite().all()) for field in layer.fields())


def test_no_gaussian_stands_before_the_continued_surface_of_another_view() -> None:
    cameras = cameras_in_a_row(0.0, 1.0)
    scene = wall(cameras)
    means = rearrange(scene.means, "(v h w) xyz -> v h w xyz", v=2, h=SIDE)
    means[1] = camera_to_world_points(cameras, pixel_rays(cameras, SIDE, SIDE) * 3.0 * WALL)[1]
    layer = background_layer(scene, cameras, (SIDE, SIDE))
    uv = layer.means[:, :2] - torch.tensor([1.0, 0.0])
    uv = uv / layer.means[:, 2:] + 0.5
    is_near_the_second_image = ((uv > -0.4) & (uv < 1.4)).all(dim=-1)
    assert bool(is_near_the_second_image.any())
    assert float(layer.means[is_near_the_second_image, 2].min()) > 0.99 * 3.0 * WALL


def test_views_all_around_a_point_get_no_gaussian_between_the_cameras() -> None:
    cameras = turned_about_y(cameras_in_a_row(*([0.0] * 8)), torch.arange(8) * (torch.pi / 4))
    cameras.extrinsics[:, :3, 3] = -WALL * cameras.extrinsics[:, :3, 2]
    layer = background_layer(wall(cameras), cameras, (SIDE, SIDE))
    from_each = torch.cdist(cameras.extrinsics[:, :3, 3], layer.means)
    assert layer.count > 0
    assert float(from_each.min()) > 0.5 * WALL
