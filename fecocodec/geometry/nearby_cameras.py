"""Cameras that a viewer may be expected to choose: between the given ones, a little beyond and beside."""

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras

# Along the way from a camera to its neighbour, and beside it (down in the image), in lengths of the way.
STEPS = ((-0.3, 0.0), (0.5, 0.3), (0.5, -0.3), (1.3, 0.0))


def nearby_cameras(cameras: Cameras, most: int) -> Cameras | None:
    """At most `most` cameras on the ways between each camera and the closest one that looks a similar way.

    Positions are interpolated linearly, rotations as the nearest rotation to the mean of matrices (Moakher, "Means and
    Averaging in the Group of Rotations", 2002). None where no two cameras look a similar way from different places.
    """
    poses = [
        _between(cameras.extrinsics[first], cameras.extrinsics[second], *step)
        for first, second in _neighbours(cameras)
        for step in STEPS
    ]
    if not poses:
        return None
    chosen = torch.stack(poses)[torch.linspace(0, len(poses) - 1, min(most, len(poses))).round().long()]
    intrinsics = cameras.intrinsics[:1].expand(len(chosen), -1, -1)
    return Cameras(chosen, intrinsics, cameras.near, cameras.far)


def cameras_between(cameras: Cameras) -> Cameras | None:
    """Cameras half-way between each camera and the closest one that looks a similar way; None where there are none."""
    poses = [
        _between(cameras.extrinsics[first], cameras.extrinsics[second], 0.5, 0.0)
        for first, second in _neighbours(cameras)
    ]
    if not poses:
        return None
    return Cameras(torch.stack(poses), cameras.intrinsics[:1].expand(len(poses), -1, -1), cameras.near, cameras.far)


def _neighbours(cameras: Cameras) -> list[tuple[int, int]]:
    """Pairs of a camera and the closest one that looks within 90 degrees of it, each pair once."""
    centres, forward = cameras.extrinsics[:, :3, 3], cameras.extrinsics[:, :3, 2]
    distance = torch.cdist(centres, centres)
    distance[(forward @ forward.T <= 0) | (distance <= 1e-6 * distance.max())] = torch.inf
    pairs = {
        (min(view, other), max(view, other))
        for view, other in enumerate(distance.argmin(dim=1).tolist())
        if distance[view, other].isfinite()
    }
    return sorted(pairs)


def _between(
    first: Float[Tensor, "4 4"], second: Float[Tensor, "4 4"], step: float, drop: float
) -> Float[Tensor, "4 4"]:
    mixed = (1 - step) * first + step * second
    left, _, right = torch.linalg.svd(mixed[:3, :3])
    pose = mixed.clone()
    pose[:3, :3] = left @ right
    pose[:3, 3] += drop * (second[:3, 3] - first[:3, 3]).norm() * pose[:3, 1]
    return pose
