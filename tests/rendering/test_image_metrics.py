"""PSNR of known errors, SSIM and MS-SSIM against an implementation that is not ours."""

import pytest
import pytorch_msssim
import torch
import torch.nn.functional as F

from fecocodec.errors import InputError
from fecocodec.rendering.metrics import ms_ssim, psnr, ssim


def noisy_pair(height: int = 31, width: int = 40) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(0)
    image = torch.rand(2, 3, height, width, generator=generator).double()
    return image, (image + 0.2 * torch.randn(image.shape, generator=generator)).clamp(0, 1)


def test_psnr_of_a_known_error() -> None:
    image = torch.full((2, 3, 8, 8), 0.5)
    error = torch.tensor([0.1, 0.01])[:, None, None, None]
    torch.testing.assert_close(psnr(image + error, image), torch.tensor([20.0, 40.0]), atol=1e-3, rtol=0)
    image, ignored = torch.full((1, 3, 8, 8), 0.5), torch.zeros(1, 8, 8, dtype=torch.bool)
    ignored[0, :4] = True
    error = torch.where(ignored[:, None], 0.4, 0.1)
    for added in (0.0, 1e-10):
        found = psnr(image + error, image, ignored, added_error=added)
        torch.testing.assert_close(found, torch.tensor([20.0]), atol=1e-3, rtol=0)
    assert float(psnr(image + error, image)) < 11.0


def test_ssim_is_that_of_another_implementation() -> None:
    image, target = noisy_pair()
    expected = pytorch_msssim.ssim(image, target, data_range=1.0, size_average=False)
    torch.testing.assert_close(ssim(image, target), expected, atol=1e-6, rtol=0)


def test_every_third_window_tells_ssim_and_its_gradient() -> None:
    image, target = noisy_pair(120, 130)
    image.requires_grad_()
    whole, some = (ssim(image, target, stride) for stride in (1, 3))
    torch.testing.assert_close(some, whole, atol=0.001, rtol=0)
    gradients = [torch.autograd.grad(value.sum(), image)[0].flatten() for value in (whole, some)]
    assert float(torch.nn.functional.cosine_similarity(*gradients, dim=0)) > 0.99
    torch.testing.assert_close(gradients[1].norm(), gradients[0].norm(), rtol=0.01, atol=0)


@pytest.mark.parametrize("metric", [psnr, ssim])
def test_metrics_are_differentiable(metric) -> None:
    image, target = noisy_pair(12, 13)
    assert torch.autograd.gradcheck(metric, (image[:1, :1].requires_grad_(), target[:1, :1]))


def test_small_images_are_refused() -> None:
    with pytest.raises(InputError, match="10x40 pixels is not defined; give at least 11 pixels a side"):
        ssim(*noisy_pair(10, 40))
    image = torch.zeros(1, 3, 175, 300)
    with pytest.raises(InputError, match="MS-SSIM of an image of 175x300 pixels is not defined; give at least 176"):
        ms_ssim(image, image)


@pytest.mark.parametrize("size", [(256, 256), (256, 448), (176, 208)])
def test_agrees_with_another_implementation(size: tuple[int, int]) -> None:
    generator = torch.Generator().manual_seed(0)
    images = F.avg_pool2d(torch.rand(2, 3, *size, generator=generator), 5, 1, 2)
    noisy = (images + 0.2 * torch.randn(2, 3, *size, generator=generator)).clamp(0, 1)
    expected = pytorch_msssim.ms_ssim(images, noisy, data_range=1.0, size_average=False)
    torch.testing.assert_close(ms_ssim(images, noisy), expected, atol=2e-5, rtol=0)
    torch.testing.assert_close(ms_ssim(images, images), torch.ones(2))
