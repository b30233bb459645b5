"""The paper's distortion, with its perceptual term."""

from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from fecocodec.errors import InputError, ModelError
from fecocodec.rendering import lpips
from fecocodec.rendering.lpips import lpips_vgg
from fecocodec.rendering.perceptual import st_lpips
from fecocodec.sender.distortion import PerceptualDistortion


@pytest.mark.parametrize(("arguments", "distance"), [((), lpips_vgg), (("st-lpips",), st_lpips)])
def test_the_papers_distortion_adds_a_twentieth_of_the_perceptual_distance(
    arguments: tuple[str, ...], distance: Callable[[Tensor, Tensor], Tensor]
) -> None:
    generator = torch.Generator().manual_seed(0)
    renderings, images = (torch.rand(2, 3, 32, 32, generator=generator) for _ in range(2))
    renderings.requires_grad_()
    found = PerceptualDistortion(*arguments)(renderings, images)
    squared = (renderings - images).square().mean(dim=(1, 2, 3))
    torch.testing.assert_close(found, squared + 0.05 * distance(renderings, images))
    plain, whole = (torch.autograd.grad(x.sum(), renderings, retain_graph=True)[0] for x in (squared, found))
    assert (whole - plain).abs().sum() > 0.0


def test_without_a_perceptual_distance_it_is_the_squared_error() -> None:
    renderings, images = torch.rand(2, 2, 3, 32, 32, generator=torch.Generator().manual_seed(0))
    found = PerceptualDistortion("none")(renderings, images)
    torch.testing.assert_close(found, (renderings - images).square().mean(dim=(1, 2, 3)))
    with pytest.raises(InputError, match="no perceptual distance 'vgg'; choose one of lpips, st-lpips, none"):
        PerceptualDistortion("vgg")


def test_missing_weights_are_noticed_before_training(monkeypatch: pytest.MonkeyPatch) -> None:
    PerceptualDistortion().require_weights()
    monkeypatch.setattr(lpips, "is_lpips_there", lambda *_: False)
    PerceptualDistortion("st-lpips").require_weights()
    with pytest.raises(ModelError, match="wheels leave out; install from a clone, or choose ST-LPIPS"):
        PerceptualDistortion().require_weights()
