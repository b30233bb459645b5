"""The paper's distortion, with its perceptual term."""

import pytest
import torch

from fecocodec.errors import InputError
from fecocodec.rendering.perceptual import st_lpips
from fecocodec.sender.distortion import PerceptualDistortion


def test_the_papers_distortion_adds_a_twentieth_of_the_perceptual_distance() -> None:
    generator = torch.Generator().manual_seed(0)
    renderings, images = (torch.rand(2, 3, 32, 32, generator=generator) for _ in range(2))
    renderings.requires_grad_()
    found = PerceptualDistortion()(renderings, images)
    squared = (renderings - images).square().mean(dim=(1, 2, 3))
    torch.testing.assert_close(found, squared + 0.05 * st_lpips(renderings, images))
    plain, whole = (torch.autograd.grad(x.sum(), renderings, retain_graph=True)[0] for x in (squared, found))
    assert (whole - plain).abs().sum() > 0.0


def test_unknown_distances_are_refused() -> None:
    with pytest.raises(InputError, match="no perceptual distance 'vgg'; choose one of st-lpips, lpips"):
        PerceptualDistortion("vgg")
