"""The decoded scene as NumPy arrays, and its cameras."""

from dataclasses import dataclass

import numpy as np

from fecocodec.container import PackedCameras
from fecocodec.geometry.gaussian_arrays import GaussianArrays, SceneCameras


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
