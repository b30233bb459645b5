"""Splats, the projections of Gaussians to one image, and the pinhole cameras of kernels."""

from typing import NamedTuple

import numpy as np

from fecocodec.geometry.cameras import Cameras
from fecocodec.kernels.compilation import compiled

DIFFERENTIABLE_FIELDS = ("x", "y", "conic_xx", "conic_xy", "conic_yy", "opacity", "red", "green", "blue", "depth")
"""Fields that carry gradients; a row of splat gradients has one column for each, in this order."""

# x, y: centre in pixels, pixel centres at i + 0.5. conic: inverse of the 2x2 covariance, in 1 / pixels^2.
# depth: z along the optical axis. cutoff: exponent above which alpha is below ALPHA_MIN.
# radius_x, radius_y: half size in pixels of the box outside which alpha is below ALPHA_MIN; 0 if invisible.
SPLAT = np.dtype([(name, np.float32) for name in (*DIFFERENTIABLE_FIELDS, "cutoff", "radius_x", "radius_y")])

ALPHA_MAX = np.float32(0.999)
TRANSMITTANCE_MIN = np.float32(1e-4)  # a pixel is finished once its transmittance is below this

Vector3 = tuple[float, float, float]


class Pinhole(NamedTuple):
    """One camera in pixels, with its image size, as kernels take it.

    rotation (rows) and translation: world to camera. eye: camera centre in the world frame. near: Gaussians whose mean
    is closer than this depth are not drawn.
    """

    rotation: tuple[Vector3, Vector3, Vector3]
    translation: Vector3
    eye: Vector3
    focal_x: float
    focal_y: float
    centre_x: float
    centre_y: float
    width: int
    height: int
    near: float


def pinholes(cameras: Cameras, image_size: tuple[int, int], near: float) -> list[Pinhole]:
    """Convert the cameras of one scene. image_size: (height, width) in pixels. near: in scene units."""
    height, width = image_size
    return [
        Pinhole(
            rotation=(_vector(rows[0]), _vector(rows[1]), _vector(rows[2])),
            translation=(rows[0][3], rows[1][3], rows[2][3]),
            eye=(pose[0][3], pose[1][3], pose[2][3]),
            focal_x=intrinsics[0][0],
            focal_y=intrinsics[1][1],
            centre_x=intrinsics[0][2],
            centre_y=intrinsics[1][2],
            width=width,
            height=height,
            near=near,
        )
        for pose, rows, intrinsics in zip(
            cameras.extrinsics.tolist(),
            cameras.world_to_camera.tolist(),
            cameras.intrinsics_px(height, width).tolist(),
            strict=True,
        )
    ]


def _vector(row: list[float]) -> Vector3:
    return row[0], row[1], row[2]


@compiled
def falloff(exponent):  # type: ignore[no-untyped-def]
    """Return exp(-exponent) of `Lanes` in [0, 6] with a relative error below 3e-6.

    Minimax polynomial of exp(-exponent / 8), squared three times. Lanes above 6 may be infinite; they are not used,
    because alpha is below ALPHA_MIN from ln 255 = 5.54 on.
    """
    root = np.float32(9.65796413135044e-06) + exponent * np.float32(-1.745353500777486e-07)
    root = np.float32(-0.00032392379188796926) + exponent * root
    root = np.float32(0.007810199126091689) + exponent * root
    root = np.float32(-0.12499875964526308) + exponent * root
    root = np.float32(0.9999998988236805) + exponent * root
    fourth = root * root
    fourth = fourth * fourth
    return fourth * fourth
