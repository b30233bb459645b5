"""Virtual cameras near the given ones: between them, slightly beyond them and beside their connecting line."""

import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras

# Positions relative to a camera and its neighbour: along their baseline, then along the downward axis of the image. The
# unit is the baseline.
STEPS = ((-0.3, 0.0), (0.5, 0.3), (0.5, -0.3), (1.3, 0.0))


def nearby_cameras(cameras: Cameras, most: int) -> Cameras | None:
    """Return at most `most` virtual cameras, at STEPS between each camera and its nearest neighbour.

    Neighbours are cameras whose optical axes differ by less than 90 degrees. Positions are interpolated linearly; the
    rotation is the one nearest to the weighted mean of the two matrices (Moakher, "Means and Averaging in the Group of
    Rotations", 2002). Intrinsics are those of the first camera. Returns None if no camera has a neighbour.
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
    """Return the cameras midway between each camera and its nearest neighbour; None if there are none.

    Poses are interpolated as in `nearby_cameras`.
    """
    poses = [
        _between(cameras.extrinsics[first], cameras.extrinsics[second], 0.5, 0.0)
        for first, second in _neighbours(cameras)
    ]
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


def _between(
    first: Float[Tensor, "4 4"], second: Float[Tensor, "4 4"], step: float, drop: float
) -> Float[Tensor, "4 4"]:
    """Interpolate two poses at `step`, then move the result down by `drop` baselines."""
    mixed = (1 - step) * first + step * second
    left, _, right = torch.linalg.svd(mixed[:3, :3])
    pose = mixed.clone()
    pose[:3, :3] = left @ right
    pose[:3, 3] += drop * (second[:3, 3] - first[:3, 3]).norm() * pose[:3, 1]
    return pose
