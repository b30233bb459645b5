"""Per-view distortion D, the same for training and for optimising latents."""

import math
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.rendering.metrics import ssim


@runtime_checkable
class Distortion(Protocol):
    """renderings, images [*batch view 3 h w], sRGB -> D of each view. target_weight: of a target view in training,
    against 1 for a context view."""

    @property
    def target_weight(self) -> float: ...

    def __call__(
        self,
        renderings: Float[Tensor, "*batch 3 height width"],
        images: Float[Tensor, "*batch 3 height width"],
        ssim_stride: int = 1,
    ) -> Float[Tensor, "*batch"]: ...


@dataclass(frozen=True)
class MseDistortion:
    """D = mean squared error + 0.03 (1 - SSIM). ssim_stride: see `metrics.ssim`."""

    target_weight: ClassVar[float] = 2.0
    ssim_weight: float = 0.03

    def __call__(
        self,
        renderings: Float[Tensor, "*batch 3 height width"],
        images: Float[Tensor, "*batch 3 height width"],
        ssim_stride: int = 1,
    ) -> Float[Tensor, "*batch"]:
        squared = (renderings - images).square().mean(dim=(-3, -2, -1))
        return squared + self.ssim_weight * (1.0 - ssim(renderings.clamp(0, 1), images, ssim_stride))


@dataclass(frozen=True)
class LogDistortion:
    """D = 0.01 log(mean squared error + 2e-4) + 0.01 (1 - SSIM): views count by their PSNR, not by their error."""

    target_weight: ClassVar[float] = 3.0
    log_weight: float = 0.01
    least_error: float = 2e-4
    ssim_weight: float = 0.01

    def __call__(
        self,
        renderings: Float[Tensor, "*batch 3 height width"],
        images: Float[Tensor, "*batch 3 height width"],
        ssim_stride: int = 1,
    ) -> Float[Tensor, "*batch"]:
        squared = (renderings - images).square().mean(dim=(-3, -2, -1))
        structure = 1.0 - ssim(renderings.clamp(0, 1), images, ssim_stride)
        return self.log_weight * torch.log(squared + self.least_error) + self.ssim_weight * structure


def mean_psnr(renderings: Float[Tensor, "view 3 height width"], images: Float[Tensor, "view 3 height width"]) -> float:
    """PSNR in dB of all views together, at most 100, of renderings clamped to [0, 1]."""
    squared = float((renderings.clamp(0, 1) - images).square().mean())
    return -10.0 * math.log10(max(squared, 1e-10))
