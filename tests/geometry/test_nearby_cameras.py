"""Virtual cameras are rigid and midway between neighbours; there are none without neighbours."""

import torch

from fecocodec.geometry.cameras import cameras_between
from tests.example_scenes import example_cameras


def test_they_are_rigid_and_as_many_as_neighbours() -> None:
    between = cameras_between(example_cameras(3))
    assert between is not None and between.num_views == 2
    rotations = between.extrinsics[:, :3, :3]
    torch.testing.assert_close(rotations @ rotations.mT, torch.eye(3).expand(2, 3, 3), atol=1e-5, rtol=0)


def test_there_are_none_of_one_view_and_of_views_at_one_place() -> None:
    cameras = example_cameras(2)
    assert cameras_between(cameras.select([0])) is None
    assert cameras_between(cameras.select([1, 1])) is None


def test_half_way_is_half_of_the_way_and_of_the_turn() -> None:
    cameras = example_cameras(2)
    between = cameras_between(cameras)
    assert between is not None and between.num_views == 1
    first, second, middle = *cameras.extrinsics, between.extrinsics[0]
    torch.testing.assert_close(middle[:3, 3], (first[:3, 3] + second[:3, 3]) / 2)
    torch.testing.assert_close(middle[:3, :3] @ first[:3, :3].T, second[:3, :3] @ middle[:3, :3].T, atol=1e-5, rtol=0)
