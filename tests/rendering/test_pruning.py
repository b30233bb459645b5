"""Pruning takes away what no picture shows, and nothing that one does."""

import torch

from fecocodec.geometry.gaussians import Gaussians
from fecocodec.rendering.pruning import needed
from tests.example_scenes import example_cameras

SIZE = (32, 32)


def test_hidden_gaussians_go_and_visible_ones_stay() -> None:
    cameras = example_cameras(2)
    pose = cameras.extrinsics[0]
    behind_camera = torch.linspace(-9.0, -3.0, 50)
    depths = torch.cat((torch.linspace(2.0, 6.0, 50), behind_camera))
    sideways = 0.8 * torch.sin(torch.arange(100.0))
    gaussians = Gaussians(
        means=pose[:3, 3] + depths[:, None] * pose[:3, 2] + sideways[:, None] * pose[:3, 0],
        scales=torch.full((100, 3), 0.1),
        rotations=torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(100, 1),
        opacities=torch.full((100,), 0.5),
        harmonics=torch.ones(100, 1, 3),
    )
    kept = needed(gaussians, cameras, SIZE)
    assert int(kept[:50].sum()) >= 40, "those in front are seen"
    assert int(kept[50:].sum()) <= 10, "those behind are not"
