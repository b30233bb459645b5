"""The decoded scene as NumPy arrays, its cameras, and the frame in which the networks work."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from fecocodec.container import PackedCameras
from fecocodec.geometry.gaussian_arrays import GaussianArrays, SceneCameras

CENTRE_STEPS = 2**13  # FORMAT.md, section 6.4
RATIO_BITS = 11


@dataclass(frozen=True)
class Decoded:
    """A decoded scene.

    gaussians: in the world frame and unit of length of the cameras. cameras: of the context views.
    image_size: (height, width) of the context views in pixels. stages: number of stages decoded, 1 or 2.
    damage: error message about the rest of the stream, None for an intact stream.
    """

    gaussians: GaussianArrays
    cameras: SceneCameras
    image_size: tuple[int, int]
    stages: int
    damage: str | None


def unpack(packed: PackedCameras) -> SceneCameras:
    """Return the cameras that a stream holds."""
    extrinsics = np.tile(np.eye(4, dtype=np.float32), (packed.num_views, 1, 1))
    extrinsics[:, :3] = np.array(packed.extrinsics, np.float32).reshape(-1, 3, 4)
    intrinsics = np.tile(np.eye(3, dtype=np.float32), (packed.num_views, 1, 1))
    rows, columns = [0, 1, 0, 1], [0, 1, 2, 2]
    intrinsics[:, rows, columns] = np.array(packed.intrinsics, np.float32)
    return SceneCameras(extrinsics, intrinsics, packed.near, packed.far)


@dataclass(frozen=True)
class SceneFrame:
    """Transformation from the normalised frame to the world frame: `world = scale * normalised + origin`."""

    origin: Float64[np.ndarray, "3"]
    scale: float

    def to_world(self, gaussians: GaussianArrays) -> GaussianArrays:
        """Return Gaussians of the normalised frame in the world frame and the unit of length of the cameras."""
        means = (gaussians.means.astype(np.float64) * self.scale + self.origin).astype(np.float32)
        scales = gaussians.scales * np.float32(self.scale)
        return GaussianArrays(means, scales, gaussians.rotations, gaussians.opacities, gaussians.harmonics)


def normalise(cameras: SceneCameras) -> tuple[SceneCameras, SceneFrame]:
    """Transform cameras to the normalised frame, in which near is 1, and round them (FORMAT.md, section 6.4)."""
    centres = cameras.extrinsics[:, :3, 3].astype(np.float64)
    origin = np.add.accumulate(centres, axis=0)[-1] / len(centres)  # summed in the order of the views
    extrinsics = cameras.extrinsics.copy()
    extrinsics[:, :3, 3] = np.floor(CENTRE_STEPS * ((centres - origin) / cameras.near) + 0.5) / CENTRE_STEPS
    mantissa, exponent = math.frexp(cameras.far / cameras.near)
    far = math.ldexp(math.floor(mantissa * 2**RATIO_BITS + 0.5), exponent - RATIO_BITS)
    return SceneCameras(extrinsics, cameras.intrinsics, 1.0, far), SceneFrame(origin, cameras.near)
