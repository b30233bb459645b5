"""3D Gaussians, the representation that the codec reconstructs."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.geometry.gaussian_arrays import SH_DEGREE_0 as SH_DEGREE_0
from fecocodec.geometry.gaussian_arrays import SH_DEGREE_1 as SH_DEGREE_1
from fecocodec.geometry.gaussian_arrays import GaussianArrays


@dataclass(frozen=True)
class Gaussians:
    """3D Gaussians in the world frame and unit of length of the cameras from which they were predicted.

    means: centres. scales: standard deviations along the local axes. rotations: unit quaternions wxyz, local axes to
    world. opacities: in [0, 1]. harmonics: real SH coefficients per colour channel in the order of 3DGS,
    `d_sh = (degree + 1)^2`; the sRGB colour in a viewing direction is `max(0, 0.5 + sum_i harmonics_i Y_i(direction))`.
    """

    means: Float[Tensor, "*batch n 3"]
    scales: Float[Tensor, "*batch n 3"]
    rotations: Float[Tensor, "*batch n 4"]
    opacities: Float[Tensor, "*batch n"]
    harmonics: Float[Tensor, "*batch n d_sh 3"]

    @classmethod
    def of(cls, gaussians: "Gaussians | GaussianArrays") -> "Gaussians":
        """Return Gaussians as tensors; those of arrays share their memory."""
        return cls(*map(torch.as_tensor, gaussians.fields()))

    @property
    def count(self) -> int:
        return self.means.shape[-2]

    def scene(self, index: int) -> "Gaussians":
        """Return the Gaussians of one scene of a batch."""
        return Gaussians(*(field[index] for field in self.fields()))

    def keep(self, mask: Bool[Tensor, " n"]) -> "Gaussians":
        """Return the Gaussians for which the mask is true, in the same order."""
        return Gaussians(*(field[mask] for field in self.fields()))

    def to(self, device: torch.device | str) -> "Gaussians":
        return Gaussians(*(field.to(device) for field in self.fields()))

    def fields(self) -> tuple[Tensor, ...]:
        return self.means, self.scales, self.rotations, self.opacities, self.harmonics
