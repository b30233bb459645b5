"""Virtual cameras between the given ones."""

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras


def cameras_between(cameras: Cameras) -> Cameras | None:
    """Return the cameras midway between each camera and its nearest neighbour; None if there are none.

    Neighbours are cameras whose optical axes differ by less than 90 degrees. The rotation is the one nearest to the
    mean of the two matrices (Moakher, "Means and Averaging in the Group of Rotations", 2002). Intrinsics are those of
    the first camera.
    """
    poses = [_midway(cameras.extrinsics[first], cameras.extrinsics[second]) for first, second in _neighbours(cameras)]
    if not poses:
        return None
    return Cameras(torch.stack(poses), cameras.intrinsics[:1].expand(len(poses), -1, -1), cameras.near, cameras.far)


def _neighbours(cameras: Cameras) -> list[tuple[int, int]]:
    """Return the pairs of a camera and the nearest one whose optical axis is within 90 degrees, each pair once."""
    centres, forward = cameras.extrinsics[:, :3, 3], cameras.extrinsics[:, :3, 2]
    distance = torch.cdist(centres, centres)
    distance[(forward @ forward.T <= 0) | (distance <= 1e-6 * distance.max())] = torch.inf
    pairs = {
        (min(view, other), max(view, other))
        for view, other in enumerate(distance.argmin(dim=1).tolist())
        if distance[view, other].isfinite()
    }
    return sorted(pairs)


def _midway(first: Float[Tensor, "4 4"], second: Float[Tensor, "4 4"]) -> Float[Tensor, "4 4"]:
    pose = 0.5 * first + 0.5 * second
    left, _, right = torch.linalg.svd(pose[:3, :3])
    pose[:3, :3] = left @ right
    return pose
