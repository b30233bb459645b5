"""How much cameras see of each other, from their poses alone: for captures that come without covisibility."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

_PIXELS, _DEPTHS = 8, 5  # sample points: a grid over the image, at depths even in inverse depth


def frustum_overlap(
    extrinsics: Float[ndarray, "frame 4 4"], intrinsics: Float[ndarray, "frame 3 3"], near: float, far: float
) -> Float[ndarray, "frame frame"]:
    """The share of each frame's space between near and far that another frame has in its image, the smaller of the two
    directions; 1 on the diagonal.

    extrinsics: camera-to-world, OpenCV axes, scene units. intrinsics: normalised by image width and height. Surfaces
    that hide each other are not known here, so this is an upper bound of what frames really share.
    """
    points = _sample_points(extrinsics, intrinsics, near, far)
    share = np.stack([_share_inside(points, pose, lens) for pose, lens in zip(extrinsics, intrinsics, strict=True)], 1)
    overlap: ndarray = np.minimum(share, share.T)
    np.fill_diagonal(overlap, 1.0)
    return overlap


def _sample_points(extrinsics: ndarray, intrinsics: ndarray, near: float, far: float) -> Float[ndarray, "frame n 3"]:
    places = (np.arange(_PIXELS) + 0.5) / _PIXELS
    u, v = (grid.ravel() for grid in np.meshgrid(places, places))
    rays = np.stack((u, v, np.ones_like(u)), axis=-1) @ np.linalg.inv(intrinsics).transpose(0, 2, 1)
    depths = 1.0 / np.linspace(1.0 / far, 1.0 / near, _DEPTHS)
    seen = (rays[:, :, None] * depths[:, None]).reshape(len(extrinsics), -1, 3)
    points: ndarray = seen @ extrinsics[:, :3, :3].transpose(0, 2, 1) + extrinsics[:, None, :3, 3]
    return points


def _share_inside(
    points: Float[ndarray, "frame n 3"], pose: Float[ndarray, "4 4"], lens: Float[ndarray, "3 3"]
) -> Float[ndarray, " frame"]:
    seen = (points - pose[:3, 3]) @ pose[:3, :3]
    depth = seen[..., 2]
    is_in_front = depth > 0
    uv = (seen @ lens.T)[..., :2] / np.where(is_in_front, depth, 1.0)[..., None]
    is_inside = is_in_front & ((uv > 0) & (uv < 1)).all(-1)
    share: ndarray = is_inside.mean(-1)
    return share
