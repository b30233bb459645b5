"""The normalised frame, in which all networks work: origin at the mean camera centre, unit of length = near. No torch.

Camera centres and far are rounded to a grid in this frame (FORMAT.md, section 6.4). A change of the unit of length
changes cameras by rounding errors of float32; the grid removes them, so that the coded bits do not change.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from fecocodec.geometry.gaussian_arrays import GaussianArrays, SceneCameras

CENTRE_STEPS = 2**13  # grid steps of a camera centre per near: rounding moves images by under 0.05 pixels
RATIO_BITS = 11  # significant bits of far / near


@dataclass(frozen=True)
class SceneFrame:
    """Transformation `world = scale * normalised + origin`. origin: in scene units. scale: near, in scene units."""

    origin: Float64[np.ndarray, "3"]
    scale: float

    def to_world(self, gaussians: GaussianArrays) -> GaussianArrays:
        """Return Gaussians of the normalised frame in the world frame and the unit of length of the cameras."""
        means = (gaussians.means.astype(np.float64) * self.scale + self.origin).astype(np.float32)
        scales = gaussians.scales * np.float32(self.scale)
        return GaussianArrays(means, scales, gaussians.rotations, gaussians.opacities, gaussians.harmonics)


def normalise(cameras: SceneCameras) -> tuple[SceneCameras, SceneFrame]:
    """Transform cameras to the normalised frame, in which near is 1, and round them; ties round up."""
    centres = cameras.extrinsics[:, :3, 3].astype(np.float64)
    origin = np.add.accumulate(centres, axis=0)[-1] / len(centres)  # summed in the order of the views
    extrinsics = cameras.extrinsics.copy()
    extrinsics[:, :3, 3] = np.floor(CENTRE_STEPS * ((centres - origin) / cameras.near) + 0.5) / CENTRE_STEPS
    mantissa, exponent = math.frexp(cameras.far / cameras.near)  # mantissa in [0.5, 1)
    far = math.ldexp(math.floor(mantissa * 2**RATIO_BITS + 0.5), exponent - RATIO_BITS)
    return SceneCameras(extrinsics, cameras.intrinsics, 1.0, far), SceneFrame(origin, cameras.near)
