"""Contributions sum to the opacity of the image and vanish for hidden Gaussians."""

import torch

from fecocodec.geometry.gaussians import Gaussians
from fecocodec.rendering.contribution import contributions
from fecocodec.rendering.rasterizer import render
from tests.example_scenes import example_cameras

SIZE = (32, 32)


def in_front_of(depths: tuple[float, ...]) -> Gaussians:
    """Opaque grey balls in front of the first of `example_cameras`."""
    pose = example_cameras(2).extrinsics[0]
    count = len(depths)
    return Gaussians(
        means=pose[:3, 3] + torch.tensor(depths)[:, None] * pose[:3, 2],
        scales=torch.full((count, 3), 0.3),
        rotations=torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(count, 1),
        opacities=torch.full((count,), 0.95),
        harmonics=torch.zeros(count, 1, 3),
    )


def test_contributions_sum_to_the_opacity_of_each_image() -> None:
    cameras, gaussians = example_cameras(2), in_front_of((2.0, 3.0, 5.0))
    weights = contributions(gaussians, cameras, SIZE)
    opacity = render(gaussians, cameras, SIZE).alpha.flatten(1).sum(dim=1)
    torch.testing.assert_close(weights.sum(dim=1), opacity, rtol=1e-3, atol=1e-3)


def test_what_is_behind_the_camera_or_hidden_contributes_little() -> None:
    front, hidden, behind = contributions(in_front_of((2.0, 2.1, -3.0)), example_cameras(2), SIZE)[0].tolist()
    assert behind == 0.0 and 0.0 < hidden < 0.5 * front
