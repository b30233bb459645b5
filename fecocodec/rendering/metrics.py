"""Image metrics, differentiable: PSNR, SSIM and MS-SSIM."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from fecocodec.errors import InputError

_WINDOW = 11  # pixels a side
_SIGMA_PX = 1.5
_STABILISER_MEAN, _STABILISER_VARIANCE = 0.01**2, 0.03**2  # (K1 L)^2 and (K2 L)^2 for a data range of L = 1
_SCALE_EXPONENTS = (0.0448, 0.2856, 0.3001, 0.2363, 0.1333)  # from the finest scale to the coarsest
MS_SSIM_LEAST_SIDE = _WINDOW * 2 ** (len(_SCALE_EXPONENTS) - 1)
Images = Float[Tensor, "*batch channel height width"]


def require_sides(images: Images, least: int, metric: str) -> None:
    """Raise InputError if a metric is not defined for images of this size."""
    height, width = images.shape[-2:]
    if min(height, width) < least:
        raise InputError(
            f"{metric} of an image of {height}x{width} pixels is not defined; give at least {least} pixels a side."
        )


def psnr(
    images: Images,
    targets: Images,
    ignored: Bool[Tensor, "*batch height width"] | None = None,
    *,
    added_error: float = 0.0,
) -> Float[Tensor, "*batch"]:
    """Return the peak signal-to-noise ratio of each image in dB, for values in [0, 1]; infinite for equal images.

    ignored: pixels that do not count; None if all do. added_error: added to the mean squared error; with more than 0
    the ratio and its gradient are finite.
    """
    squares = (images - targets).square()
    if ignored is None:
        mean = squares.mean(dim=(-3, -2, -1))
    else:
        kept = (~ignored.to(squares.device)).to(squares)
        mean = (squares.mean(dim=-3) * kept).sum(dim=(-2, -1)) / kept.sum(dim=(-2, -1)).clamp(min=1.0)
    return -10.0 * torch.log10(mean + added_error)


def ssim(images: Images, targets: Images, stride: int = 1) -> Float[Tensor, "*batch"]:
    """Return the structural similarity of each image, for values in [0, 1]; 1 for equal images.

    Wang et al., "Image Quality Assessment: From Error Visibility to Structural Similarity", 2004: Gaussian window of
    11x11 pixels with sigma 1.5, population statistics, mean over the channels and the windows inside the image.

    stride: 1 for SSIM; above it, an estimate from every `stride`-th window along each axis. Up to 3, the weights of all
    pixels are equal within 2%.

    Raises InputError if an image is smaller than the window.
    """
    require_sides(images, _WINDOW, "SSIM")
    luminance, structure = _luminance_and_structure(images, targets, stride)
    return (luminance * structure).mean(dim=(-3, -2, -1))


def ms_ssim(
    images: Float[Tensor, "image channel height width"], targets: Float[Tensor, "image channel height width"]
) -> Float[Tensor, " image"]:
    """Return the multi-scale structural similarity of each image, for values in [0, 1]; 1 for equal images.

    Wang, Simoncelli and Bovik, "Multi-scale Structural Similarity for Image Quality Assessment", 2003: five
    scales, each the mean over 2x2 pixels of the previous one; negative structure counts as 0; mean over the channels.

    Raises InputError if a side is under 176 pixels, because the coarsest scale must hold one window.
    """
    require_sides(images, MS_SSIM_LEAST_SIDE, "MS-SSIM")
    product = torch.ones(images.shape[:2], device=images.device, dtype=images.dtype)
    for scale, exponent in enumerate(_SCALE_EXPONENTS, start=1):
        luminance, structure = _luminance_and_structure(images, targets)
        similarity = luminance * structure if scale == len(_SCALE_EXPONENTS) else structure
        product = product * similarity.mean(dim=(-2, -1)).clamp_min(0.0) ** exponent
        images, targets = functional.avg_pool2d(images, 2), functional.avg_pool2d(targets, 2)
    return product.mean(dim=-1)


def _luminance_and_structure(
    images: Images, targets: Images, stride: int = 1
) -> tuple[Float[Tensor, "*batch channel height_in width_in"], Float[Tensor, "*batch channel height_in width_in"]]:
    """Return the two factors of SSIM at each window; structure includes contrast."""
    rows, columns = (_windows(side, images)[::stride] for side in images.shape[-2:])

    def blurred(values: Tensor) -> Tensor:
        """Weighted mean over windows, by two products with band matrices, which a CPU computes much faster than
        single-channel convolutions."""
        return rows @ values @ columns.T

    mean, target_mean = blurred(images), blurred(targets)
    variance = blurred(images * images) - mean * mean
    target_variance = blurred(targets * targets) - target_mean * target_mean
    covariance = blurred(images * targets) - mean * target_mean
    luminance = (2 * mean * target_mean + _STABILISER_MEAN) / (mean**2 + target_mean**2 + _STABILISER_MEAN)
    structure = (2 * covariance + _STABILISER_VARIANCE) / (variance + target_variance + _STABILISER_VARIANCE)
    return luminance, structure


def _windows(side: int, like: Float[Tensor, "*shape"]) -> Float[Tensor, "side_in side"]:
    """Return the pixel weights of every window inside a line of `side` pixels, one row per window."""
    offset = torch.arange(_WINDOW, device=like.device, dtype=like.dtype) - _WINDOW // 2
    window = torch.exp(-0.5 * (offset / _SIGMA_PX) ** 2)
    window = window / window.sum()
    matrix = torch.zeros(side - _WINDOW + 1, side, device=like.device, dtype=like.dtype)
    for position, weight in enumerate(window):
        matrix.diagonal(position).fill_(weight)
    return matrix
