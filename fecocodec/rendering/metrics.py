"""How alike two images are: PSNR and SSIM, differentiable."""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from fecocodec.errors import InputError

_WINDOW = 11  # pixels a side
_SIGMA_PX = 1.5
_STABILISER_MEAN, _STABILISER_VARIANCE = 0.01**2, 0.03**2  # (K1 L)^2 and (K2 L)^2 for a data range of L = 1


def psnr(
    images: Float[Tensor, "*batch channel height width"], targets: Float[Tensor, "*batch channel height width"]
) -> Float[Tensor, "*batch"]:
    """Peak signal-to-noise ratio of each image in dB, for values in [0, 1]; infinite where images are equal."""
    error = (images - targets).square().mean(dim=(-3, -2, -1))
    return -10.0 * torch.log10(error)


def ssim(
    images: Float[Tensor, "*batch channel height width"], targets: Float[Tensor, "*batch channel height width"]
) -> Float[Tensor, "*batch"]:
    """Structural similarity of each image, for values in [0, 1]; 1 where images are equal.

    Wang et al., "Image Quality Assessment: From Error Visibility to Structural Similarity", 2004: Gaussian window of
    11x11 pixels with sigma 1.5, population statistics, mean over the channels and the windows inside the image.

    Raises InputError when an image is smaller than the window.
    """
    if min(images.shape[-2:]) < _WINDOW:
        raise InputError(
            f"SSIM of an image of {images.shape[-2]}x{images.shape[-1]} pixels is not defined; "
            f"give at least {_WINDOW} pixels a side."
        )
    mean, target_mean = _blurred(images), _blurred(targets)
    variance = _blurred(images * images) - mean * mean
    target_variance = _blurred(targets * targets) - target_mean * target_mean
    covariance = _blurred(images * targets) - mean * target_mean
    luminance = (2 * mean * target_mean + _STABILISER_MEAN) / (mean**2 + target_mean**2 + _STABILISER_MEAN)
    structure = (2 * covariance + _STABILISER_VARIANCE) / (variance + target_variance + _STABILISER_VARIANCE)
    return (luminance * structure).mean(dim=(-3, -2, -1))


def _blurred(
    images: Float[Tensor, "*batch channel height width"],
) -> Float[Tensor, "*batch channel height_in width_in"]:
    """Weighted mean over each window that lies inside the image."""
    offset = torch.arange(_WINDOW, device=images.device, dtype=images.dtype) - _WINDOW // 2
    window = torch.exp(-0.5 * (offset / _SIGMA_PX) ** 2)
    window = window / window.sum()
    planes = images.reshape(-1, 1, *images.shape[-2:])
    planes = functional.conv2d(functional.conv2d(planes, window[None, None, :, None]), window[None, None, None, :])
    return planes.reshape(*images.shape[:-2], *planes.shape[-2:])
