"""Cameras: inverses, rays, projection and depth.

Virtual cameras are rigid and midway between neighbours; there are none without neighbours.
"""

import pytest
import torch

from fecocodec.geometry.cameras import (
    camera_to_world_points,
    cameras_between,
    depth_from_relative_disparity,
    pixel_rays,
    relative_disparity_from_depth,
)
from tests.example_scenes import example_cameras


def test_cameras_are_inverted_and_selected() -> None:
    cameras = example_cameras(5)
    product = cameras.world_to_camera @ cameras.extrinsics
    torch.testing.assert_close(product, torch.eye(4).expand(5, 4, 4), atol=1e-6, rtol=0)
    chosen = cameras.select([2, 0])
    assert chosen.num_views == 2
    assert torch.equal(chosen.extrinsics[0], cameras.extrinsics[2])
    back = chosen.as_batch().scene(0)
    assert all(torch.equal(one, other) for one, other in zip(back.fields(), chosen.fields(), strict=True))


@pytest.mark.parametrize(("height", "width"), [(8, 8), (5, 13)])
def test_points_along_pixel_rays_project_back_to_pixel_centres(height: int, width: int) -> None:
    cameras = example_cameras(3)
    depth = 1.0 + torch.rand(3, height, width, generator=torch.Generator().manual_seed(1)) * 10
    points = camera_to_world_points(cameras, pixel_rays(cameras, height, width) * depth[..., None])
    row, column = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
    for view in range(3):
        uv, found, is_visible = (field[0] for field in cameras.select([view]).project(points[view]))
        torch.testing.assert_close(found, depth[view], atol=1e-4, rtol=1e-5)
        torch.testing.assert_close(
            uv * torch.tensor([width, height]), torch.stack((column, row), -1), atol=1e-3, rtol=0
        )
        assert bool(is_visible.all())


def test_points_behind_a_camera_or_beside_its_image_are_not_visible() -> None:
    cameras = example_cameras(2)
    intrinsics = cameras.intrinsics[0]
    corner = torch.tensor([(1.01 - intrinsics[0, 2]) / intrinsics[0, 0], 0.0, 1.0])
    local = torch.stack((torch.tensor([0.0, 0.0, 3.0]), torch.tensor([0.0, 0.0, -3.0]), 5.0 * corner))
    world = local @ cameras.extrinsics[0, :3, :3].T + cameras.extrinsics[0, :3, 3]
    projection = cameras.project(world)
    assert projection.is_visible[0].tolist() == [True, False, False]
    torch.testing.assert_close(projection.depth[0], torch.tensor([3.0, -3.0, 5.0]))
    assert projection.uv.shape == (2, 3, 2) and bool(projection.uv.isfinite().all())


def test_relative_disparity_runs_from_far_to_near_and_back() -> None:
    cameras = example_cameras(2, near=0.5, far=40.0)
    relative = torch.linspace(0.0, 1.0, 12).view(1, 3, 4).repeat(2, 1, 1)
    depth = depth_from_relative_disparity(relative, cameras)
    torch.testing.assert_close(depth[0, 0, 0], torch.tensor(40.0))
    torch.testing.assert_close(depth[0, -1, -1], torch.tensor(0.5))
    torch.testing.assert_close(relative_disparity_from_depth(depth, cameras), relative, atol=1e-6, rtol=0)
    depth = depth_from_relative_disparity(torch.full((2, 1, 1), -1e6), example_cameras(2, far=40.0))
    assert torch.equal(depth, torch.full((2, 1, 1), 80.0))


def test_cameras_between_neighbours() -> None:
    between = cameras_between(example_cameras(3))
    assert between is not None and between.num_views == 2
    rotations = between.extrinsics[:, :3, :3]
    torch.testing.assert_close(rotations @ rotations.mT, torch.eye(3).expand(2, 3, 3), atol=1e-5, rtol=0)
    cameras = example_cameras(2)
    assert cameras_between(cameras.select([0])) is None
    assert cameras_between(cameras.select([1, 1])) is None
    between = cameras_between(cameras)
    assert between is not None and between.num_views == 1
    first, second, middle = *cameras.extrinsics, between.extrinsics[0]
    torch.testing.assert_close(middle[:3, 3], (first[:3, 3] + second[:3, 3]) / 2)
    torch.testing.assert_close(middle[:3, :3] @ first[:3, :3].T, second[:3, :3] @ middle[:3, :3].T, atol=1e-5, rtol=0)
