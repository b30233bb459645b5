"""Validation of poses from files."""

import numpy as np
from jaxtyping import Float

from fecocodec.errors import InputError

MAX_SCALE_ERROR = 1e-2
MAX_ROTATION_ERROR = 1e-3


def rigid_pose(matrix: Float[np.ndarray, "4 4"], place: str) -> Float[np.ndarray, "4 4"]:
    """Return the rigid pose nearest to a 4x4 camera-to-world matrix with rounding errors, in float64.

    A scale within 1% and errors of the axes up to 1e-3 are corrected (nearest rotation by SVD, Schönemann 1966).
    Raises InputError, which begins with `place`, if the matrix is singular, mirrored, scaled or sheared.
    """
    axes = matrix[:3, :3]
    if not np.allclose(matrix[3], (0, 0, 0, 1), atol=MAX_ROTATION_ERROR):
        raise InputError(f"{place}: the last row of the pose is not 0 0 0 1; export camera-to-world matrices.")
    if not np.abs(axes).max() < 1e6:
        raise InputError(f"{place}: the axes of the pose are far from unit length; export camera-to-world matrices.")
    determinant = float(np.linalg.det(axes))
    if abs(determinant) < 1e-12:
        raise InputError(f"{place}: the pose is singular (its axes span no volume); export the cameras again.")
    if determinant < 0:
        raise InputError(
            f"{place}: the pose is mirrored (determinant {determinant:.3g}); export right-handed camera axes."
        )
    scale = np.cbrt(determinant)
    left, _, right = np.linalg.svd(axes)
    rotation = left @ right
    error = float(np.abs(axes / scale - rotation).max())
    if abs(scale - 1) > MAX_SCALE_ERROR or error > MAX_ROTATION_ERROR:
        raise InputError(
            f"{place}: the pose is no rotation (scale {scale:.4g}, axes off by {error:.2g}); "
            "export camera-to-world matrices without scale and shear."
        )
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, matrix[:3, 3]
    return pose


def require_float32_range(poses: Float[np.ndarray, "view 4 4"], place: str) -> None:
    """Raise InputError if cameras are so far from the origin that float32 cannot represent their distances."""
    centres = poses[:, :3, 3]
    extent = float(np.ptp(centres, axis=0).max())
    farthest = float(np.abs(centres).max())
    if farthest > 1e30 or (extent > 0 and farthest * np.finfo(np.float32).eps > 1e-3 * extent):
        raise InputError(
            f"{place}: the cameras lie {extent:.3g} apart but {farthest:.3g} from the origin, too far for float32; "
            "move the origin of the scene near the cameras."
        )
