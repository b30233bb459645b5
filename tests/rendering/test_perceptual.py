"""ST-LPIPS against values of the original package; gradients."""

import json
from pathlib import Path

import pytest
import torch

from fecocodec.errors import InputError
from fecocodec.rendering.perceptual import ST_LPIPS_LEAST_SIDE, ST_LPIPS_WEIGHTS, st_lpips
from tests.rendering.picture_pairs import picture_pairs

VALUES = json.loads((Path(__file__).parent / "st_lpips_values.json").read_text())


@pytest.mark.parametrize("name", VALUES)
def test_distances_are_those_of_the_original_package(name: str) -> None:
    """The stored values come from weights in float32; ours are rounded to fp16."""
    images, targets = picture_pairs()[name]
    assert float(st_lpips(images, targets)) == pytest.approx(VALUES[name], rel=1e-3)


def test_equal_images_have_distance_zero_and_batches_keep_their_shape() -> None:
    images = torch.rand(2, 3, 3, 24, 32, generator=torch.Generator().manual_seed(1))
    assert torch.equal(st_lpips(images, images), torch.zeros(2, 3))
    targets = images.clone()
    targets[1, 2] *= 0.5
    distances = st_lpips(images, targets)
    assert distances[1, 2] > 0 and int((distances > 0).sum()) == 1


def test_gradients_reach_the_images_and_not_the_network() -> None:
    images, targets = (picture.clone() for picture in picture_pairs()["darker, small"])
    images = targets.clone().requires_grad_()
    st_lpips(images, picture_pairs()["darker, small"][0]).sum().backward()
    assert images.grad is not None and images.grad.isfinite().all() and images.grad.abs().sum() > 0
    step = images.detach() - 0.05 * images.grad / images.grad.abs().max()
    before, after = (float(st_lpips(x, picture_pairs()["darker, small"][0])) for x in (images.detach(), step))
    assert after < before


def test_gradients_of_uniform_pictures_are_finite() -> None:
    images = torch.zeros(1, 3, 24, 24, requires_grad=True)
    st_lpips(images, torch.ones(1, 3, 24, 24)).sum().backward()
    assert images.grad is not None and images.grad.isfinite().all()


def test_small_images_are_refused() -> None:
    side = ST_LPIPS_LEAST_SIDE
    assert st_lpips(torch.rand(1, 3, side, side), torch.rand(1, 3, side, side)).isfinite().all()
    with pytest.raises(InputError, match="ST-LPIPS of an image of 20x40 pixels is not defined; give at least 21"):
        st_lpips(torch.rand(1, 3, side - 1, 40), torch.rand(1, 3, side - 1, 40))


def test_the_weights_ship_with_their_licence() -> None:
    assert "BSD 2-Clause License" in (ST_LPIPS_WEIGHTS.parent / "LICENSE").read_text()
    assert ST_LPIPS_WEIGHTS.stat().st_size < 5e6
