"""Baselines: what is sent is what is counted, and comes back as what it was."""

import sys

import pytest
import torch

from fecocodec.errors import InputError
from fecocodec.evaluation.systems.gaussian_compression import GAUSSIAN_FORMATS, decode_gaussians, encode_gaussians
from fecocodec.evaluation.systems.image_compression import QUALITY_LADDERS, decode_image, encode_image
from fecocodec.evaluation.systems.trivial_baselines import trivial_baselines
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.rendering.metrics import psnr
from tests.example_scenes import example_views


@pytest.mark.parametrize("codec", QUALITY_LADDERS)
def test_a_ladder_rises_in_bytes_and_quality(codec: str) -> None:
    image = example_views(1, 64, 96).images[0]
    files = [encode_image(image, codec, quality) for quality in QUALITY_LADDERS[codec]]
    qualities = [float(psnr(decode_image(file, codec), image)) for file in files]
    sizes = [len(file) for file in files]
    assert sizes == sorted(sizes) and len(set(sizes)) == len(sizes)
    assert qualities == sorted(qualities) and qualities[-1] > qualities[0] + 2


@pytest.mark.parametrize("form", GAUSSIAN_FORMATS)
def test_gaussians_come_back(form: str) -> None:
    generator = torch.Generator().manual_seed(0)
    gaussians = Gaussians(
        means=torch.randn(300, 3, generator=generator),
        scales=0.01 + 0.1 * torch.rand(300, 3, generator=generator),
        rotations=torch.nn.functional.normalize(torch.randn(300, 4, generator=generator), dim=-1),
        opacities=0.1 + 0.8 * torch.rand(300, generator=generator),
        harmonics=torch.randn(300, 1, 3, generator=generator),
    )
    data = encode_gaussians(gaussians, form)
    found = decode_gaussians(data, form)
    assert found.count == 300 and len(data) < 300 * 72 + 1000
    for mine, theirs in zip(gaussians.means.T, found.means.T, strict=True):  # formats may reorder
        torch.testing.assert_close(mine.sort()[0], theirs.sort()[0], atol=5e-3, rtol=0)
    torch.testing.assert_close(gaussians.opacities.sort()[0], found.opacities.sort()[0], atol=1e-2, rtol=0)


def test_floor_of_equal_cameras_is_exact() -> None:
    """Where the target's camera is a context view's, the nearest view and every plane give that view back."""
    views = example_views(2).select([0, 0])
    for system in trivial_baselines():
        found = system.reconstruct(views, 1)
        torch.testing.assert_close(found.images[1], views.images[0], atol=1e-3, rtol=0)


def test_a_missing_library_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "imagecodecs", None)
    with pytest.raises(InputError, match=r"AVIF needs the package imagecodecs.*pip install '\.\[eval\]'"):
        encode_image(example_views(1).images[0], "AVIF", 50.0)
