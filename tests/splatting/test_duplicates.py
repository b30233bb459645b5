"""Duplicates: a wall that three cameras at different distances show."""

import pytest
import torch
from torch import Tensor

from fecocodec.config import ReceiverConfig
from fecocodec.geometry.cameras import Cameras, camera_to_world_points, pixel_rays
from fecocodec.splatting.duplicates import kept_share
from tests.example_scenes import cameras_in_a_row

SIDE = 32  # Gaussians a side
WALL = 6.0  # z of a wall
OPACITY = 0.7
CONFIG = ReceiverConfig()


def cameras_at(*z: float) -> Cameras:
    """Return cameras on the z axis that look along it."""
    return cameras_in_a_row(*z, axis=2, far=10.0).as_batch()


def kept(cameras: Cameras, shift_of_last: float = 0.0, opacity_of_last: float = OPACITY) -> Tensor:
    """Return the kept share of the Gaussians of each view, where all views show the wall.

    shift_of_last: of the wall that the last view shows, along z.
    """
    distance = WALL - cameras.extrinsics[0, :, 2, 3]
    distance[-1] += shift_of_last
    depth = distance[None, :, None, None].expand(1, -1, SIDE, SIDE)
    means = camera_to_world_points(cameras, pixel_rays(cameras, SIDE, SIDE) * depth[..., None])
    colour = torch.full((*depth.shape, 3), 0.5)
    opacity = torch.full_like(depth, OPACITY)
    opacity[:, -1] = opacity_of_last
    return kept_share(means, depth, colour, opacity, opacity, cameras, CONFIG)[0]


CENTRE = (slice(12, 20), slice(12, 20))


def test_far_views_give_way_to_the_nearest_one_that_sees_it() -> None:
    found = kept(cameras_at(0.0, 1.0, 4.0))
    far, middle, near = (float(view[CENTRE].mean()) for view in found)
    assert near > 0.999
    assert middle == pytest.approx(1.0 - OPACITY, abs=0.01)
    assert far == pytest.approx((1.0 - OPACITY) ** 2, abs=0.02)
    assert found[0, 0, 0] > 0.999 and found[0, CENTRE[0], CENTRE[1]].max() < 0.2
    cameras = cameras_at(0.0, 0.0, 0.0)
    cameras.intrinsics[0, 2, :2, :2] *= 2.0
    found = kept(cameras)
    assert found[2].min() > 0.999 and found[0][CENTRE].max() < 0.5
    found = kept(cameras_at(2.0, 2.0, 2.0))
    torch.testing.assert_close(found, torch.full_like(found, (1.0 - OPACITY / 2) ** 2))


@pytest.mark.parametrize("shift", [-1.5, 1.5])
def test_another_surface_fades_nothing(shift: float) -> None:
    found = kept(cameras_at(0.0, 0.0, 2.0), shift_of_last=shift)
    assert found[0][CENTRE].min() > 0.6  # the two equal views fade each other to 0.65
    assert kept(cameras_at(0.0, 0.0, 2.0))[0][CENTRE].max() < 0.3


def test_views_fade_others_as_far_as_they_are_opaque() -> None:
    found = kept(cameras_at(0.0, 1.0, 4.0), opacity_of_last=0.01)
    assert found[1][CENTRE].min() > 0.95
    assert torch.equal(kept(cameras_at(0.0, 4.0)), torch.ones(2, SIDE, SIDE))
