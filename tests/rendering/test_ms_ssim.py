"""MS-SSIM against an implementation that is not ours."""

import pytest
import pytorch_msssim
import torch
import torch.nn.functional as F

from fecocodec.errors import InputError
from fecocodec.rendering.metrics import ms_ssim


@pytest.mark.parametrize("size", [(256, 256), (256, 448), (176, 208)])
def test_agrees_with_another_implementation(size: tuple[int, int]) -> None:
    generator = torch.Generator().manual_seed(0)
    images = F.avg_pool2d(torch.rand(2, 3, *size, generator=generator), 5, 1, 2)
    noisy = (images + 0.2 * torch.randn(2, 3, *size, generator=generator)).clamp(0, 1)
    expected = pytorch_msssim.ms_ssim(images, noisy, data_range=1.0, size_average=False)
    torch.testing.assert_close(ms_ssim(images, noisy), expected, atol=2e-5, rtol=0)
    torch.testing.assert_close(ms_ssim(images, images), torch.ones(2))


def test_small_images_are_refused() -> None:
    image = torch.zeros(1, 3, 175, 300)
    with pytest.raises(InputError, match="MS-SSIM of an image of 175x300 pixels is not defined; give at least 176"):
        ms_ssim(image, image)
