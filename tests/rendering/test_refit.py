"""Mending brings pictures back; places, number and order of the Gaussians stay."""

from dataclasses import replace

import torch

from fecocodec.rendering.rasterizer import render
from fecocodec.rendering.refit import refit
from tests.rendering.small_scenes import random_gaussians, two_cameras

SIZE = (32, 32)


def test_pictures_of_fewer_gaussians_come_back() -> None:
    cameras, whole = two_cameras(), random_gaussians(200)
    pictures = render(whole, cameras, SIZE).color
    fewer = whole.keep(torch.arange(whole.count) % 4 > 0)
    found = refit(fewer, cameras, pictures)
    before, after = ((render(one, cameras, SIZE).color - pictures).square().mean() for one in (fewer, found))
    assert 0.0 < after < 0.5 * before
    assert torch.equal(found.means, fewer.means) and torch.equal(found.rotations, fewer.rotations)
    assert bool(((found.opacities > 0) & (found.opacities < 1)).all()) and bool((found.scales > 0).all())
    assert all(not field.requires_grad for field in found.fields())


def test_what_no_camera_sees_stays() -> None:
    cameras, gaussians = two_cameras(), random_gaussians(20)
    gaussians = replace(gaussians, means=-1.0 - gaussians.means.abs(), opacities=torch.full((20,), 0.5))
    found = refit(gaussians, cameras, torch.rand(2, 3, *SIZE))
    for before, after in zip(gaussians.fields(), found.fields(), strict=True):
        torch.testing.assert_close(after, before)
