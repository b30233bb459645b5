"""Scenes for the renderer's tests."""

import math

import torch

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians


def two_cameras() -> Cameras:
    """Two turned views of the space in front of the origin, principal point off centre, near bound 0.5."""
    extrinsics = torch.eye(4).repeat(2, 1, 1)
    angle = 0.3
    extrinsics[1, :3, :3] = torch.tensor(
        [[math.cos(angle), 0.0, math.sin(angle)], [0.0, 1.0, 0.0], [-math.sin(angle), 0.0, math.cos(angle)]]
    )
    extrinsics[1, :3, 3] = torch.tensor([-0.5, 0.1, 0.2])
    intrinsics = torch.tensor([[0.9, 0.0, 0.52], [0.0, 1.3, 0.47], [0.0, 0.0, 1.0]]).repeat(2, 1, 1)
    return Cameras(extrinsics, intrinsics, near=torch.tensor(0.5), far=torch.tensor(50.0))


def random_gaussians(count: int, num_harmonics: int = 4, seed: int = 0) -> Gaussians:
    """Gaussians of every shape in front of `two_cameras`: thin and wide, faint and solid, some outside the image."""
    generator = torch.Generator().manual_seed(seed)

    def normal(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=generator)

    return Gaussians(
        means=torch.cat((normal(count, 2), 0.3 + 2.0 * normal(count, 1).abs()), dim=-1),
        scales=torch.exp(0.5 * normal(count, 3) - 2.0),
        rotations=normal(count, 4),
        opacities=1.2 * torch.rand(count, generator=generator),
        harmonics=0.5 * normal(count, num_harmonics, 3),
    )
