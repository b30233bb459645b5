"""Pruning removes Gaussians that are hidden or that their neighbours can replace, and no others."""

from dataclasses import replace

import torch

from fecocodec.geometry.gaussians import Gaussians
from fecocodec.rendering.pruning import LARGEST_CHANGE, prune
from fecocodec.rendering.rasterizer import render
from tests.example_scenes import example_cameras

SIZE = (32, 32)
OPACITY = 0.3


def along_first_view(depths: torch.Tensor, sideways: torch.Tensor, up: torch.Tensor, opacity: float) -> Gaussians:
    """White Gaussians at positions given in the frame of the first example camera."""
    pose = example_cameras(2).extrinsics[0]
    return Gaussians(
        means=pose[:3, 3] + torch.stack((sideways, up, depths), dim=1) @ pose[:3, :3].T,
        scales=torch.full((len(depths), 3), 0.1),
        rotations=torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(len(depths), 1),
        opacities=torch.full((len(depths),), opacity),
        harmonics=torch.ones(len(depths), 1, 3),
    )


def test_hidden_gaussians_are_removed_and_visible_ones_kept() -> None:
    depths = torch.cat((torch.linspace(2.0, 6.0, 50), torch.linspace(-9.0, -3.0, 50)))
    gaussians = along_first_view(depths, 0.8 * torch.sin(torch.arange(100.0)), torch.zeros(100), 0.5)
    gaussians.harmonics[::2] = -1.0
    kept = prune(gaussians, example_cameras(2), SIZE)
    is_kept = (gaussians.means[:, None] == kept.means).all(dim=-1).any(dim=1)
    assert int(is_kept[:50].sum()) >= 40, "Gaussians in front of the cameras are visible"
    assert int(is_kept[50:].sum()) <= 10, "Gaussians behind the cameras are not"


def wall() -> Gaussians:
    """White, half transparent Gaussians, about two per pixel, jittered."""
    side = torch.linspace(-1.5, 1.5, 60)
    up, sideways = (grid.flatten() for grid in torch.meshgrid(side, side, indexing="ij"))
    jitter = 0.05 * torch.randn(3, len(up), generator=torch.Generator().manual_seed(0))
    return along_first_view(3.0 + 0.1 * jitter[0], sideways + jitter[1], up + jitter[2], OPACITY)


def test_a_wall_of_one_colour_keeps_its_opacity_with_fewer() -> None:
    cameras, whole = example_cameras(2), wall()
    kept = prune(whole, cameras, SIZE)
    assert kept.count <= 0.6 * whole.count
    thinner = replace(kept, opacities=torch.full((kept.count,), OPACITY))
    before, after, uncompensated = (render(gaussians, cameras, SIZE).color for gaussians in (whole, kept, thinner))
    changed, thinned = (float((x - before).square().mean(dim=(1, 2, 3)).max()) for x in (after, uncompensated))
    assert changed <= LARGEST_CHANGE < thinned
    assert thinned > 2 * changed


def test_neighbours_of_other_colours_are_not_replaced() -> None:
    cameras, plain = example_cameras(2), wall()
    colours = torch.randn(plain.harmonics.shape, generator=torch.Generator().manual_seed(1))
    assert prune(replace(plain, harmonics=colours), cameras, SIZE).count > 1.2 * prune(plain, cameras, SIZE).count


def test_no_gaussians_are_returned_as_they_are() -> None:
    nothing = Gaussians(torch.zeros(0, 3), torch.zeros(0, 3), torch.zeros(0, 4), torch.zeros(0), torch.zeros(0, 1, 3))
    assert prune(nothing, example_cameras(2), SIZE) is nothing
