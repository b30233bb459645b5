"""The occluded part of the background layer fills what views from beside see behind near surfaces, and nothing else."""

from dataclasses import replace

import torch
from einops import rearrange

from fecocodec.geometry.cameras import Cameras, camera_to_world_points, pixel_rays
from fecocodec.geometry.gaussians import SH_DEGREE_0, Gaussians
from fecocodec.rendering.rasterizer import Rendering, render
from fecocodec.splatting.background import append
from fecocodec.splatting.occluded import LEAST_DISTANCE, LEAST_STEP, MOST_STEP, occluded_layer
from tests.example_scenes import cameras_in_a_row, surface
from tests.splatting.test_background import GREY, RED

SIDE = 64  # Gaussians along a side
IMAGE = (192, 192)
WALL, POST = 8.0, 3.0  # depths
BEFORE = slice(24, 40)  # columns of the post


def post_before_wall(cameras: Cameras, post: float = POST) -> Gaussians:
    """Return a red post before a grey wall, at the same place in the image of each view."""
    depth, colour = torch.full((cameras.num_views, SIDE, SIDE), WALL), GREY.repeat(cameras.num_views, SIDE, SIDE, 1)
    depth[:, :, BEFORE], colour[:, :, BEFORE] = post, RED
    return surface(cameras, depth, colour, 0.95)


def layer_of(scene: Gaussians, cameras: Cameras) -> Gaussians:
    return occluded_layer(scene, cameras, (SIDE, SIDE))


def rendered(gaussians: Gaussians, cameras: Cameras) -> Rendering:
    return render(gaussians, cameras, IMAGE)


def columns_of(layer: Gaussians) -> torch.Tensor:
    """Return where the Gaussians are in the image of a camera at the origin, in columns of the grid."""
    return SIDE * (layer.means[:, 0] / layer.means[:, 2] + 0.5)


def test_the_wall_is_continued_behind_the_post_and_nowhere_else() -> None:
    cameras = cameras_in_a_row(0.0)
    layer = layer_of(post_before_wall(cameras), cameras)
    assert layer.count == 16 * 2  # in each row of cells, two of the four behind the post; the others touch its edge
    columns = columns_of(layer)
    assert bool(((columns > BEFORE.start) & (columns < BEFORE.stop)).all())
    depth, colour = layer.means[:, 2], 0.5 + SH_DEGREE_0 * layer.harmonics[:, 0]
    assert float(depth.min()) > POST * LEAST_STEP and float(depth.max()) < 1.05 * WALL
    assert bool(((colour - GREY).norm(dim=1) < (colour - RED).norm(dim=1)).all())


def test_a_view_from_beside_has_no_hole_behind_the_post() -> None:
    cameras, beside = cameras_in_a_row(0.0), cameras_in_a_row(-1.0, 1.0)
    scene = post_before_wall(cameras)
    before, after = rendered(scene, beside), rendered(append(scene, layer_of(scene, cameras)), beside)
    hole = before.alpha < 0.5
    hole[:, :, :24] = hole[:, :, -24:] = False  # outside the image of the scene
    assert float(hole.float().mean()) > 0.03
    assert float((hole & (after.alpha < 0.5)).float().sum()) < 0.5 * float(hole.float().sum())
    filled = after.color.permute(1, 0, 2, 3)[:, hole & (after.alpha > 0.9)].mean(dim=1)
    assert float((filled - GREY).norm()) < float((filled - RED).norm())


def test_nothing_is_continued_without_steps_of_depth_or_too_far() -> None:
    cameras = cameras_in_a_row(0.0, 1.0)
    assert layer_of(post_before_wall(cameras, WALL), cameras).count == 0
    assert layer_of(post_before_wall(cameras, 0.97 * WALL), cameras).count == 0
    cameras = cameras_in_a_row(0.0)
    scene = post_before_wall(cameras)
    opacities = scene.opacities.clone().view(SIDE, SIDE)
    opacities[:, : BEFORE.start] = opacities[:, BEFORE.stop :] = 0.0
    assert layer_of(replace(scene, opacities=opacities.flatten()), cameras).count == 0  # no wall
    opacities = scene.opacities.clone().view(SIDE, SIDE)
    opacities[::2, BEFORE] = 0.0
    assert layer_of(replace(scene, opacities=opacities.flatten()), cameras).count == 0  # half a post
    # Else a little transparency would multiply rendered depths.
    layer = layer_of(post_before_wall(cameras, 0.1 * WALL), cameras)
    assert layer.count > 0
    torch.testing.assert_close(layer.means[:, 2], torch.full((layer.count,), MOST_STEP * 0.1 * WALL))


def test_no_gaussian_stands_before_what_another_view_shows() -> None:
    """The second view shows another wall, behind the first, where the post would hide it from the first view."""
    cameras = cameras_in_a_row(0.0, 2.0)
    scene = post_before_wall(cameras)
    means = rearrange(scene.means, "(v h w) xyz -> v h w xyz", v=2, h=SIDE)
    means[1] = camera_to_world_points(cameras, pixel_rays(cameras, SIDE, SIDE) * 3.0 * WALL)[1]
    columns = SIDE * ((layer_of(scene, cameras).means[:, 0] - 2.0) / WALL + 0.5)
    assert not bool(((columns > 1.0) & (columns < SIDE - 1.0)).any())
    alone = cameras_in_a_row(0.0)
    assert layer_of(post_before_wall(alone), alone).count > 0


def test_no_gaussian_is_close_to_a_camera() -> None:
    """The second camera is behind the post and looks away from it."""
    cameras = cameras_in_a_row(0.0, 0.0)
    cameras.extrinsics[1, 2, 3] = 0.9 * WALL
    alone = cameras_in_a_row(0.0)
    found = layer_of(post_before_wall(alone), alone)
    scene = post_before_wall(cameras)
    opacities = torch.cat((scene.opacities[: SIDE * SIDE], torch.zeros(SIDE * SIDE)))
    layer = layer_of(replace(scene, opacities=opacities), cameras)
    assert 0 < layer.count < found.count
    assert float((layer.means - cameras.extrinsics[1, :3, 3]).norm(dim=1).min()) > LEAST_DISTANCE


def test_gaussians_at_infinity_or_far_and_faint_change_nothing_else() -> None:
    cameras = cameras_in_a_row(0.0)
    scene = post_before_wall(cameras)
    expected = layer_of(scene, cameras)
    scene.means[0] = torch.inf
    layer = layer_of(scene, cameras)
    assert layer.count > 0.9 * expected.count
    assert all(bool(field.isfinite().all()) for field in layer.fields())
    scene = post_before_wall(cameras)
    scene.means[0] *= 100.0
    scene.opacities[0] = 0.005
    torch.testing.assert_close(layer_of(scene, cameras).means, expected.means, atol=1e-3, rtol=1e-3)


def test_no_gaussian_stands_in_a_hole_of_another_view() -> None:
    """The second view emits nothing, as around a cut-out object."""
    cameras = cameras_in_a_row(0.0, 0.1)
    scene = post_before_wall(cameras)
    opacities = torch.cat((scene.opacities[: SIDE * SIDE], torch.zeros(SIDE * SIDE)))
    layer = layer_of(replace(scene, opacities=opacities), cameras)
    uv = (layer.means - cameras.extrinsics[1, :3, 3])[:, :2] / layer.means[:, 2:] + 0.5
    assert not bool(((uv > 0.0) & (uv < 1.0)).all(dim=1).any())
