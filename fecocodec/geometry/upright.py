"""The upright frame: the vertical of a scene, estimated from its cameras, which is stored nowhere. No torch."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

ROLL = 0.09  # radians: cameras rolled further than this about their optical axis count less and less
TILT_WEIGHT = 0.007  # cameras look up and down freely, but are hardly rolled: (2.5 degrees / 30 degrees)^2
LEAST_AGREEMENT = 0.17  # length of the mean image-up axis; a ring of cameras that look down by 80 degrees has this
_STEPS = 10


class Vertical(NamedTuple):
    """The vertical of a scene. up: unit vector in the frame of the cameras.

    is_agreed: whether the cameras agree on it. If they do not, it is the image-up axis of the first camera.
    """

    up: Float[np.ndarray, " 3"]
    is_agreed: bool


def vertical(extrinsics: Float[np.ndarray, "view 4 4"]) -> Vertical:
    """Return the direction across the right axes of the cameras that is near their median image-up axis.

    One camera, or several with equal axes, give their image-up axis. Cameras that turn about the vertical give it even
    if all of them look down. Cauchy weights leave out cameras that are rolled. Cameras that look straight down, or
    whose image-up axes cancel, do not show which way is up.
    extrinsics: camera-to-world, OpenCV axes.
    """
    right, upward = extrinsics[:, :3, 0], -extrinsics[:, :3, 1]
    if np.linalg.norm(upward.mean(axis=0)) < LEAST_AGREEMENT:
        return Vertical(upward[0], is_agreed=False)
    typical = _spherical_median(upward)
    axis = typical
    for _ in range(_STEPS):
        weights = 1 / (1 + np.square(right @ axis / ROLL))
        rolls = np.einsum("v,vi,vj->ij", weights / weights.sum(), right, right)
        axis = np.linalg.eigh(rolls - TILT_WEIGHT * np.outer(typical, typical))[1][:, 0]
    return Vertical(axis if typical @ axis > 0 else -axis, is_agreed=True)


def _spherical_median(units: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " 3"]:
    """Return the unit vector with the least sum of distances to the others (Weiszfeld 1937), starting at their mean."""
    median = units.mean(axis=0)
    for _ in range(_STEPS):
        median /= np.linalg.norm(median)
        distances = np.linalg.norm(units - median, axis=1)
        median = np.average(units, axis=0, weights=1 / np.maximum(distances, ROLL))
    return median / np.linalg.norm(median)


def to_upright_frame(
    extrinsics: Float[np.ndarray, "view 4 4"], up: Float[np.ndarray, " 3"]
) -> Float[np.ndarray, "4 4"]:
    """Return the rigid transform to the frame with the first camera at the origin, `up` along -Y, and its view near +Z.

    The first camera is level in this frame if it has no roll; a camera that looks straight along `up` keeps its right
    axis along +X.
    """
    first = extrinsics[0]
    level = first[:3, 0] - (first[:3, 0] @ up) * up
    if np.linalg.norm(level) < ROLL:  # the camera is rolled by a quarter turn
        level = np.cross(-up, first[:3, 2])
    right = level / np.linalg.norm(level)
    pose = np.eye(4)
    pose[:3, :3] = np.stack((right, -up, np.cross(right, -up)))
    pose[:3, 3] = -pose[:3, :3] @ first[:3, 3]
    return pose
