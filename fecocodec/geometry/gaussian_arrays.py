"""3D Gaussians and cameras as NumPy arrays, for the decoder and the writers of files that run without torch."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32

SH_DEGREE_0 = 0.28209479177387814  # Y_0^0; colour = 0.5 + SH_DEGREE_0 * harmonics[0]
SH_DEGREE_1 = 0.4886025119029199  # the basis is -SH_DEGREE_1 y, SH_DEGREE_1 z, -SH_DEGREE_1 x at a unit direction
ALPHA_MIN = 1.0 / 255.0  # renderers skip a Gaussian at pixels where its alpha is below this


_FIELDS = ("means", "scales", "rotations", "opacities", "harmonics")


@dataclass(frozen=True)
class GaussianArrays:
    """3D Gaussians of one scene; fields and conventions are those of `geometry.gaussians.Gaussians`."""

    means: Float[np.ndarray, "n 3"]
    scales: Float[np.ndarray, "n 3"]
    rotations: Float[np.ndarray, "n 4"]
    opacities: Float[np.ndarray, " n"]
    harmonics: Float[np.ndarray, "n d_sh 3"]

    @property
    def count(self) -> int:
        return len(self.means)

    def fields(self) -> tuple[np.ndarray, ...]:
        return self.means, self.scales, self.rotations, self.opacities, self.harmonics

    def keep(self, mask: Bool[np.ndarray, " n"]) -> "GaussianArrays":
        """Return the Gaussians for which the mask is true, in the same order."""
        return GaussianArrays(*(field[mask] for field in self.fields()))


def shape_problem(gaussians: Any) -> str | None:
    """Return a sentence if the fields of one scene's Gaussians, tensors or arrays, have other shapes than they need."""
    count, sh_axis = len(gaussians.means), gaussians.harmonics.shape[1:2]
    shapes = ((count, 3), (count, 3), (count, 4), (count,), (count, *sh_axis, 3))
    for name, field, shape in zip(_FIELDS, gaussians.fields(), shapes, strict=True):
        if tuple(field.shape) != shape:
            return f"`{name}` of the Gaussians has the shape {tuple(field.shape)}; with {count} means it needs {shape}."
    return None


@dataclass(frozen=True)
class SceneCameras:
    """Cameras of one scene; fields and conventions are those of `geometry.cameras.Cameras`."""

    extrinsics: Float32[np.ndarray, "view 4 4"]
    intrinsics: Float32[np.ndarray, "view 3 3"]
    near: float
    far: float

    @classmethod
    def of_rows(
        cls, poses: Sequence[Sequence[float]], lenses: Sequence[Sequence[float]], near: float, far: float
    ) -> "SceneCameras":
        """Return cameras of the rows of `PackedCameras`: 3x4 camera-to-world, row-major, and (fx, fy, cx, cy)."""
        extrinsics, intrinsics = (np.tile(np.eye(side, dtype=np.float32), (len(poses), 1, 1)) for side in (4, 3))
        extrinsics[:, :3] = np.array(poses, np.float32).reshape(-1, 3, 4)
        intrinsics[:, [0, 1, 0, 1], [0, 1, 2, 2]] = np.array(lenses, np.float32)
        return cls(extrinsics, intrinsics, near, far)

    @property
    def num_views(self) -> int:
        return len(self.extrinsics)

    def fields(self) -> tuple[np.ndarray | float, ...]:
        return self.extrinsics, self.intrinsics, self.near, self.far
