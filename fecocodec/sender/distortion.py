"""Per-view distortion D, used for training and for the optimisation of latents."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.errors import InputError
from fecocodec.rendering.lpips import lpips_vgg, require_lpips
from fecocodec.rendering.metrics import ssim
from fecocodec.rendering.perceptual import st_lpips

PERCEPTUAL: Mapping[str, Callable[[Tensor, Tensor], Tensor]] = MappingProxyType(
    {"lpips": lpips_vgg, "st-lpips": st_lpips, "none": lambda renderings, _images: renderings.new_zeros(())}
)

Images = Float[Tensor, "*batch 3 height width"]
PerView = Float[Tensor, "*batch"]


@runtime_checkable
class Distortion(Protocol):
    """Callable (renderings, images) -> D of each view. Both are sRGB; images are in [0, 1], renderings may exceed it.

    target_weight: weight of a target view in training; a context view has weight 1.
    """

    @property
    def target_weight(self) -> float: ...

    def __call__(self, renderings: Images, images: Images, ssim_stride: int = 1) -> PerView: ...


@dataclass(frozen=True)
class MseDistortion:
    """D = MSE + ssim_weight (1 - SSIM). ssim_stride: see `metrics.ssim`."""

    target_weight: ClassVar[float] = 2.0
    ssim_weight: float = 0.03

    def __call__(self, renderings: Images, images: Images, ssim_stride: int = 1) -> PerView:
        squared = (renderings - images).square().mean(dim=(-3, -2, -1))
        return squared + self.ssim_weight * (1.0 - ssim(renderings.clamp(0, 1), images, ssim_stride))


@dataclass(frozen=True)
class LogDistortion:
    """D = log_weight log(MSE + least_error) + ssim_weight (1 - SSIM).

    The logarithm makes D linear in the PSNR of a view, so that views with a large error do not dominate the mean.
    """

    target_weight: ClassVar[float] = 3.0
    log_weight: float = 0.01
    least_error: float = 2e-4
    ssim_weight: float = 0.01

    def __call__(self, renderings: Images, images: Images, ssim_stride: int = 1) -> PerView:
        squared = (renderings - images).square().mean(dim=(-3, -2, -1))
        structure = 1.0 - ssim(renderings.clamp(0, 1), images, ssim_stride)
        return self.log_weight * torch.log(squared + self.least_error) + self.ssim_weight * structure


@dataclass(frozen=True)
class PerceptualDistortion:
    """D = MSE + perceptual_weight * distance, the paper's (training strategy, beta = 0.05).

    perceptual: "lpips" (VGG16) as in the paper, "st-lpips" (AlexNet), or "none". The distances differ, and so do models
    trained with them. Raises InputError for another name.
    """

    target_weight: ClassVar[float] = 1.0
    perceptual: str = "lpips"
    perceptual_weight: float = 0.05

    def __post_init__(self) -> None:
        if self.perceptual not in PERCEPTUAL:
            raise InputError(
                f"There is no perceptual distance '{self.perceptual}'; choose one of {', '.join(PERCEPTUAL)}."
            )

    def require_weights(self) -> None:
        """Raise ModelError if the weights of the perceptual distance are not installed."""
        if self.perceptual == "lpips":
            require_lpips("vgg16")

    def __call__(self, renderings: Images, images: Images, ssim_stride: int = 1) -> PerView:
        squared = (renderings - images).square().mean(dim=(-3, -2, -1))
        return squared + self.perceptual_weight * PERCEPTUAL[self.perceptual](renderings, images)
