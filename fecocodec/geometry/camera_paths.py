"""Camera paths near the cameras of a scene: along them, a spiral around their mean, and an orbit around the scene."""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import accumulate, pairwise

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.upright import vertical

SPIRAL_TURNS = 2
LEAST_RADIUS = 0.02  # of the spiral, relative to the depth of its focus
RISE = 0.3  # height of the spiral, relative to its width
LEAST_ORBIT_DEGREES = 5.0  # to each side, of an orbit that is not a full turn
LEAST_CHANGE = 1e-4  # of the picture, in radians, between cameras at one position
LARGEST_GAP_DEGREES = 90.0  # between neighbouring cameras, seen from the centre, of a capture all around

QUANTILES = torch.tensor((0.1, 0.5, 0.9))  # of the depths that a view sees
DEPTH_MARGIN = 1.5  # of the depth of a centre, beyond these quantiles: the middle of an object is behind its surface
MOST_POINTS = 1 << 14  # whose depths are looked at

Pose = Float[Tensor, "4 4"]
Depths = Float[Tensor, "view 3"]  # QUANTILES of the depths that each view sees, in scene units


def between(cameras: Cameras, count: int) -> Cameras:
    """Return `count` cameras that pass through all cameras of one scene, so that pictures change at an even pace.

    Positions follow a Catmull-Rom spline (Catmull and Rom, "A class of local interpolating splines", 1974). A rotation
    is the one nearest to the weighted mean of two matrices.
    """
    change = _change_of_picture(cameras)
    order = _least_change(change)
    ordered = cameras.select(order)
    passed = [0.0, *accumulate(float(change[one, other]) for one, other in pairwise(order))]
    times = np.interp(np.linspace(0, passed[-1], count), passed, range(len(order))).tolist()
    rotations, centres = ordered.extrinsics[:, :3, :3], ordered.extrinsics[:, :3, 3]
    poses = [_pose(_nearest_rotation(_mixed(rotations, time)), _catmull_rom(centres, time)) for time in times]
    intrinsics = [_mixed(ordered.intrinsics, time) for time in times]
    return replace(cameras, extrinsics=torch.stack(poses), intrinsics=torch.stack(intrinsics))


def spiral(cameras: Cameras, count: int, depths: Depths) -> Cameras | None:
    """Return `count` cameras on a spiral around the mean camera, looking at the scene's focus (closed path).

    The focus is on the mean optical axis, at the median depth. The width of the spiral is the RMS distance of
    the cameras from their mean along the horizontal axis, at least LEAST_RADIUS of the depth of the focus. Returns None
    if a camera does not see the focus.
    """
    mean, depth = cameras.extrinsics.mean(dim=0), float(depths[:, 1].median())
    pose = _pose(_nearest_rotation(mean[:3, :3]), mean[:3, 3])
    focus = pose[:3, 3] + depth * pose[:3, 2]
    if not cameras.project(focus).is_visible.all():
        return None
    offsets = (cameras.extrinsics[:, :3, 3] - pose[:3, 3]) @ pose[:3, :3]
    width = max(float(offsets[:, 0].square().mean().sqrt()), LEAST_RADIUS * depth)
    height = max(float(offsets[:, 1].square().mean().sqrt()), RISE * width)

    def pose_at(share: float) -> Pose:
        turn = 2 * math.pi * share
        swing = offsets.new_tensor(
            (width * math.cos(SPIRAL_TURNS * turn), height * math.sin(SPIRAL_TURNS * turn), width * math.sin(turn) / 2)
        )
        return _looking_at(pose[:3, 3] + pose[:3, :3] @ swing, focus, down=pose[:3, 1])

    return _closed_path(cameras, count, pose_at)


def orbit(cameras: Cameras, count: int, depths: Depths) -> Cameras | None:
    """Return `count` cameras on a circle around the scene's centre, looking at it (closed path).

    Cameras all around the centre give a full turn. Otherwise the path swings over the angle that the cameras cover, at
    least LEAST_ORBIT_DEGREES to each side. The axis of rotation is the vertical of the scene (`vertical`); distance and
    height are means of the cameras. Returns None if no centre is seen by all cameras.
    """
    centre = _centre_of_view(cameras, depths)
    if centre is None:
        return None
    axes = _orbit_axes(cameras)
    offsets = (cameras.extrinsics[:, :3, 3] - centre) @ axes
    radius, height = float(offsets[:, [0, 2]].norm(dim=1).mean()), float(offsets[:, 1].mean())
    angles = torch.atan2(offsets[:, 0], -offsets[:, 2])  # 0 at the mean viewing direction
    first, last, is_full = _covered_angles(angles)

    def pose_at(share: float) -> Pose:
        swing = share * 2 * math.pi if is_full else (last - first) * (1 + math.sin(2 * math.pi * share)) / 2
        angle = first + swing
        offset = offsets.new_tensor((radius * math.sin(angle), height, -radius * math.cos(angle)))
        return _looking_at(centre + axes @ offset, centre, down=axes[:, 1])

    return _closed_path(cameras, count, pose_at)


def camera_path(name: str, cameras: Cameras, count: int, points: Float[Tensor, "n 3"]) -> tuple[Cameras, str | None]:
    """Return `count` cameras on the path called `name`, and a note if it is another path than that.

    points: centres of the Gaussians, in scene units; their depths in the views say where the scene is.
    """
    depths = _typical_depths(cameras, points)
    path = _AROUND_A_CENTRE[name](cameras, count, depths) if name in _AROUND_A_CENTRE else None
    if path is not None:
        return path, None
    note = f"the cameras see no common centre, so the path passes through them (between) and is no {name}."
    return between(cameras, count), None if name == "between" else note


_AROUND_A_CENTRE: dict[str, Callable[[Cameras, int, Depths], Cameras | None]] = {"spiral": spiral, "orbit": orbit}


def _typical_depths(cameras: Cameras, points: Float[Tensor, "n 3"]) -> Depths:
    """Return quantiles of the depths of the points that each camera sees; near and far for one that sees none."""
    seen = cameras.project(points[:: max(1, len(points) // MOST_POINTS)])
    depths = seen.depth.masked_fill(~seen.is_visible, torch.nan).nanquantile(QUANTILES.to(points), dim=1).T
    near, far = cameras.near, cameras.far
    return depths.where(depths.isfinite(), torch.stack((near, 2.0 / (1.0 / near + 1.0 / far), far)))


def _closed_path(cameras: Cameras, count: int, pose_at: Callable[[float], Pose]) -> Cameras:
    """Return cameras with the mean intrinsics at `pose_at(share)`, share = 0, 1 / count, 2 / count, ..."""
    poses = torch.stack([pose_at(frame / count) for frame in range(count)])
    return replace(cameras, extrinsics=poses, intrinsics=cameras.intrinsics.mean(dim=0).expand(count, -1, -1))


def _change_of_picture(cameras: Cameras) -> Float[Tensor, "view view"]:
    """Return about the angle, in radians, by which what two cameras see moves: their turn, and shift over its depth."""
    turned = cameras.extrinsics[:, None, :3, :3].mT @ cameras.extrinsics[:, :3, :3]
    cosine = (turned.diagonal(dim1=-2, dim2=-1).sum(dim=-1) - 1) / 2
    centres = cameras.extrinsics[:, :3, 3]
    shift = torch.cdist(centres, centres) * (1 / cameras.near + 1 / cameras.far) / 2
    return LEAST_CHANGE + torch.arccos(cosine.clamp(-1, 1)) + shift


def _least_change(change: Float[Tensor, "view view"]) -> list[int]:
    """Return the order of least change: the given one, or from one view always to the nearest that remains."""
    orders = [list(range(len(change)))]
    for first in range(len(change)):
        order = [first]
        while len(order) < len(change):
            others = [view for view in range(len(change)) if view not in order]
            order.append(min(others, key=lambda view: float(change[order[-1], view])))
        orders.append(order)
    return min(orders, key=lambda order: sum(float(change[one, other]) for one, other in pairwise(order)))


def _mixed(values: Float[Tensor, "view *shape"], time: float) -> Float[Tensor, "*shape"]:
    """Interpolate linearly between the values at the whole numbers around `time`."""
    index = min(int(time), max(len(values) - 2, 0))
    return torch.lerp(values[index], values[min(index + 1, len(values) - 1)], time - index)


def _catmull_rom(points: Float[Tensor, "view 3"], time: float) -> Float[Tensor, "3"]:
    """Interpolate points at 0, 1, 2, ... by a Catmull-Rom spline, with the end points repeated."""
    last = len(points) - 1
    index = min(int(time), max(last - 1, 0))
    before, start, end, after = (points[min(max(index + step, 0), last)] for step in (-1, 0, 1, 2))
    t = time - index
    linear, square = end - before, 2 * before - 5 * start + 4 * end - after
    return start + 0.5 * t * (linear + t * (square + t * (3 * (start - end) + after - before)))


def _nearest_rotation(matrix: Float[Tensor, "3 3"]) -> Float[Tensor, "3 3"]:
    left, _, right = torch.linalg.svd(matrix)
    sign = torch.ones(3).to(matrix)
    sign[2] = torch.linalg.det(left @ right)
    return left @ (sign[:, None] * right)


def _looking_at(centre: Float[Tensor, "3"], target: Float[Tensor, "3"], down: Float[Tensor, "3"]) -> Pose:
    """Return the pose at `centre` whose optical axis passes through `target`, with image rows along `down`."""
    forward = torch.nn.functional.normalize(target - centre, dim=0)
    right = torch.nn.functional.normalize(torch.linalg.cross(down, forward), dim=0)
    return _pose(torch.stack((right, torch.linalg.cross(forward, right), forward), dim=1), centre)


def _pose(rotation: Float[Tensor, "3 3"], centre: Float[Tensor, "3"]) -> Pose:
    pose = torch.eye(4).to(centre)
    pose[:3, :3], pose[:3, 3] = rotation, centre
    return pose


def _centre_of_view(cameras: Cameras, depths: Depths) -> Float[Tensor, "3"] | None:
    """Return the point nearest to all optical axes (least squares) that every camera sees at a typical depth, if any.

    Axes that cross elsewhere, as those of cameras that look outwards do, give way to the mean of the points at the
    median depths. A weak prior keeps the crossing of nearly parallel axes near that mean.
    """
    centres, forward = cameras.extrinsics[:, :3, 3], cameras.extrinsics[:, :3, 2]
    across = torch.eye(3).to(centres) - forward[:, :, None] * forward[:, None, :]
    expected = (centres + depths[:, 1:2] * forward).mean(dim=0)
    weight = 1e-2 * len(centres)
    normal = across.sum(dim=0) + weight * torch.eye(3).to(centres)
    crossing = torch.linalg.solve(normal, (across @ centres[:, :, None]).sum(dim=0)[:, 0] + weight * expected)
    for point in (crossing, expected):
        seen = cameras.project(point)
        is_typical = (seen.depth > depths[:, 0] / DEPTH_MARGIN) & (seen.depth < depths[:, 2] * DEPTH_MARGIN)
        if bool((seen.is_visible & is_typical).all()):
            return point
    return None


def _orbit_axes(cameras: Cameras) -> Float[Tensor, "3 3"]:
    """Return the axes right, down, forward as columns: down is the vertical, forward the mean view across it."""
    up = vertical(cameras.extrinsics.double().cpu().numpy()).up
    down = -torch.from_numpy(up).to(cameras.extrinsics)
    mean = cameras.extrinsics[:, :3, 2].mean(dim=0)
    first = cameras.extrinsics[0, :3, 2]
    forward = mean if float((mean - (mean @ down) * down).norm()) > 0.1 else first  # cameras all around have no mean
    forward = torch.nn.functional.normalize(forward - (forward @ down) * down, dim=0)
    return torch.stack((torch.linalg.cross(down, forward), down, forward), dim=1)


def _covered_angles(angles: Float[Tensor, " view"]) -> tuple[float, float, bool]:
    """Return the first and last angle in radians, and whether the cameras surround the centre."""
    ordered = angles.sort().values
    gaps = torch.cat((ordered[1:] - ordered[:-1], ordered[:1] + 2 * math.pi - ordered[-1:]))
    widest = int(gaps.argmax())
    if float(gaps[widest]) < math.radians(LARGEST_GAP_DEGREES):
        return 0.0, 2 * math.pi, True
    first = float(ordered[(widest + 1) % len(ordered)])
    last = first + 2 * math.pi - float(gaps[widest])
    middle, half = (first + last) / 2, max((last - first) / 2, math.radians(LEAST_ORBIT_DEGREES))
    return middle - half, middle + half, False
