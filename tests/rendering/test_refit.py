"""Refitting recovers the images; means, rotations, number and order of the Gaussians do not change."""

from dataclasses import replace

import torch

from fecocodec.rendering.rasterizer import render
from fecocodec.rendering.refit import refit
from tests.rendering.small_scenes import random_gaussians, two_cameras

SIZE = (32, 32)


def test_images_of_fewer_gaussians_are_recovered() -> None:
    cameras, whole = two_cameras(), random_gaussians(200)
    images = render(whole, cameras, SIZE).color
    fewer = whole.keep(torch.arange(whole.count) % 4 > 0)
    refitted = refit(fewer, cameras, images)
    before, after = ((render(one, cameras, SIZE).color - images).square().mean() for one in (fewer, refitted))
    assert 0.0 < after < 0.5 * before
    assert torch.equal(refitted.means, fewer.means) and torch.equal(refitted.rotations, fewer.rotations)
    assert bool(((refitted.opacities > 0) & (refitted.opacities < 1)).all()) and bool((refitted.scales > 0).all())
    assert all(not field.requires_grad for field in refitted.fields())


def test_gaussians_that_no_camera_sees_do_not_change() -> None:
    cameras, gaussians = two_cameras(), random_gaussians(20)
    gaussians = replace(gaussians, means=-1.0 - gaussians.means.abs(), opacities=torch.full((20,), 0.5))
    refitted = refit(gaussians, cameras, torch.rand(2, 3, *SIZE))
    for before, after in zip(gaussians.fields(), refitted.fields(), strict=True):
        torch.testing.assert_close(after, before)
