"""Turn and shift given cameras until points that look alike in several photographs meet.

Cameras and points minimise the robust distances of the points from where they are seen (Triggs et al., "Bundle
adjustment - a modern synthesis", 2000): Gauss-Newton steps, points eliminated by the Schur complement, weights of Geman
and McClure (1987) whose scale falls, so that far points count first. Corners are exact to a pixel of 256, so cameras
that fit so well are left alone: adjusting them costs quality (docs/what_we_learned.md).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float, Int
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.depth_range import agreed_depths, facing_baselines
from fecocodec.geometry.point_tracks import Observations, observations
from fecocodec.geometry.rotations import cross_product_matrix, rotation_of_vector
from fecocodec.geometry.sparse_matches import CORNER_SIDE, Corners
from fecocodec.geometry.views import Views

_SCALES = (64.0, 64.0, 32.0, 32.0, 16.0, 16.0, 8.0, 8.0, 4.0, 4.0, 2.0, 2.0, 1.0, 1.0, 1.0)  # of the weights, by step
_NOISE = 0.5  # standard deviation of a corner's position
_TURN, _SHIFT = math.radians(1.0), 0.01  # of given cameras, shifts in distances to the nearest camera
_LEAST_POINTS = 10  # for each photograph on average
# Chosen on training captures (docs/what_we_learned.md): least fall of the mean cost, which is at most 0.04 where given
# cameras are right; and largest median error in pixels, against wrong cameras that fit a little better.
_LEAST_GAIN, _MOST_ERROR = 0.07, 1.5
_MOST_LOST = 0.2  # of the share of pixels whose depths agree


@dataclass(frozen=True)
class Adjusted:
    """Cameras that fit better. error: median of points, in pixels of CORNER_SIDE. degrees: largest turn of a camera."""

    cameras: Cameras
    error: float
    degrees: float

    @property
    def remark(self) -> str:
        """Say it to the user."""
        return (
            f"the cameras do not fit the photographs; they are shifted, and turned by up to {self.degrees:.1f} "
            f"degrees, until points that look alike meet within {self.error:.1f} of {CORNER_SIDE} pixels."
        )


def adjusted(
    cameras: Cameras, corners: Sequence[Corners], num_fixed: int = 0, photographs: Views | None = None
) -> Adjusted | None:
    """Return cameras that fit clearly better than the given ones; None if there are none, or few points look alike.

    corners: of each camera's photograph. num_fixed: how many of the first cameras stay. The mean pose of the others
    hardly changes. photographs: of the first cameras; their depths must not agree much less than with the given ones.
    """
    seen = observations(cameras, corners)
    if seen.num_points < _LEAST_POINTS * cameras.num_views:
        return None
    unit = facing_baselines(cameras).double().amin(dim=1)
    unit = unit.masked_fill(unit.isinf(), 0.0)  # of a camera that no other faces
    size = unit.max()  # the unit of length does not matter
    given, unit = cameras.extrinsics.double().clone(), unit / size
    given[:, :3, 3] /= size
    change, free = torch.zeros(len(given), 6, dtype=torch.float64), slice(6 * num_fixed, None)
    for scale in _SCALES:
        matrix, right = _equations(seen, _moved(given, change, unit), unit, change, scale)
        change[num_fixed:] -= torch.linalg.solve(matrix[free, free], right[free]).view(-1, 6)
    moved = _moved(given, change, unit)
    is_judged = seen.views >= num_fixed
    before, after = (_errors(seen, extrinsics)[is_judged] for extrinsics in (given, moved))
    error = float(after.median())
    is_better = _cost(before) - _cost(after) >= _LEAST_GAIN and error <= _MOST_ERROR  # not for NaN
    if not is_better:
        return None
    moved[:, :3, 3] *= size
    extrinsics = cameras.extrinsics.clone()
    extrinsics[num_fixed:] = moved[num_fixed:]
    better = replace(cameras, extrinsics=extrinsics)
    if photographs is not None and _loses_depth(photographs, better):
        return None
    return Adjusted(better, error, math.degrees(float(change[:, :3].norm(dim=1).max())))


def adjusted_with_checks(
    cameras: Cameras, corners: Sequence[Corners], num_checks: int, photographs: Views
) -> tuple[Cameras, Adjusted | None]:
    """Adjust cameras, then the last `num_checks` to the others: they are only measured, so they move no other.

    Returns all cameras, and what was done to the others. photographs: as for `adjusted`.
    """
    num_used = cameras.num_views - num_checks
    used = cameras.select(list(range(num_used)))
    better = adjusted(used, corners[:num_used], photographs=photographs)
    if better is not None:
        used = better.cameras
    cameras = used.joined(cameras.select(list(range(num_used, cameras.num_views))))
    of_checks = adjusted(cameras, corners, num_fixed=num_used) if num_checks else None
    return cameras if of_checks is None else of_checks.cameras, better


def _loses_depth(views: Views, cameras: Cameras) -> bool:
    """Return whether plane sweeps of these views agree much less: repeated patterns fit wrong cameras, too."""
    moved = replace(views, cameras=cameras.select(list(range(len(views.images)))))
    return agreed_depths(views).share - agreed_depths(moved).share > _MOST_LOST


def _moved(
    given: Float[Tensor, "view 4 4"], change: Float[Tensor, "view 6"], unit: Float[Tensor, " view"]
) -> Float[Tensor, "view 4 4"]:
    """Turn each camera about itself by a rotation vector, and shift it by so many units."""
    moved = given.clone()
    moved[:, :3, :3] = given[:, :3, :3] @ rotation_of_vector(change[:, :3])
    moved[:, :3, 3] += change[:, 3:] * unit[:, None]
    return moved


def _triangulated(
    seen: Observations, extrinsics: Float[Tensor, "view 4 4"], weights: Float[Tensor, " seen"]
) -> Float[Tensor, "point 3"]:
    """Return the points nearest to their rays."""
    rays = torch.cat((seen.rays, torch.ones_like(seen.rays[:, :1])), dim=1)
    poses = extrinsics[seen.views]
    directions = torch.nn.functional.normalize((poses[:, :3, :3] @ rays[..., None])[..., 0], dim=1)
    across = torch.eye(3, dtype=rays.dtype) - directions[:, :, None] * directions[:, None]
    across = across * weights.clamp_min(1e-3)[:, None, None]
    matrix = _sums(across, seen.points, seen.num_points)
    right = _sums(across @ poses[:, :3, 3:], seen.points, seen.num_points)
    solved: Tensor = torch.linalg.solve(matrix + 1e-9 * torch.eye(3, dtype=rays.dtype), right)
    return solved[..., 0]


def _sums(values: Float[Tensor, "seen *shape"], index: Int[Tensor, " seen"], count: int) -> Float[Tensor, "n *shape"]:
    return values.new_zeros(count, *values.shape[1:]).index_add(0, index, values)


def _seen_from_cameras(
    seen: Observations, extrinsics: Float[Tensor, "view 4 4"], points: Float[Tensor, "point 3"]
) -> tuple[Float[Tensor, "seen 3"], Float[Tensor, "seen 2"]]:
    """Return the points in the frames of their cameras, and their distances from where they are seen, in pixels."""
    poses = extrinsics[seen.views]
    local = (poses[:, :3, :3].mT @ (points[seen.points] - poses[:, :3, 3])[..., None])[..., 0]
    return local, (local[:, :2] / _depth(local)[:, None] - seen.rays) * seen.focal_px[:, None]


def _depth(local: Float[Tensor, "seen 3"]) -> Float[Tensor, " seen"]:
    """Return depths; a tiny one for points behind the camera, which are then far from where they are seen."""
    return local[:, 2].clamp_min(1e-9)


def _points(
    seen: Observations, extrinsics: Float[Tensor, "view 4 4"], scale: float
) -> tuple[Float[Tensor, "point 3"], Float[Tensor, " seen"]]:
    """Return the points for these cameras, and the weights of what is seen."""
    weights = torch.ones_like(seen.focal_px)
    for _ in range(3):
        points = _triangulated(seen, extrinsics, weights)
        distances = _seen_from_cameras(seen, extrinsics, points)[1]
        weights = (1.0 + distances.square().sum(dim=1) / scale**2) ** -2
    return points, weights


def _errors(seen: Observations, extrinsics: Float[Tensor, "view 4 4"]) -> Float[Tensor, " seen"]:
    return _seen_from_cameras(seen, extrinsics, _points(seen, extrinsics, _SCALES[-1])[0])[1].norm(dim=1)


def _cost(errors: Float[Tensor, " seen"]) -> float:
    """Return the mean of the robust costs, each from 0 to 1."""
    return float((errors.square() / (_SCALES[-1] ** 2 + errors.square())).mean())


def _equations(
    seen: Observations,
    extrinsics: Float[Tensor, "view 4 4"],
    unit: Float[Tensor, " view"],
    change: Float[Tensor, "view 6"],
    scale: float,
) -> tuple[Float[Tensor, "unknown unknown"], Float[Tensor, " unknown"]]:
    """Return the equations of the Gauss-Newton step that is subtracted from `change`: their matrix and right side."""
    points, weights = _points(seen, extrinsics, scale)
    local, distances = _seen_from_cameras(seen, extrinsics, points)
    by_camera, by_point = _derivatives(seen, extrinsics, unit, local)
    weighted = weights[:, None, None] / _NOISE**2
    num_views, one = len(change), torch.eye(3, dtype=torch.float64)
    of_cameras = _sums(by_camera.mT @ by_camera * weighted, seen.views, num_views)
    of_points = _sums(by_point.mT @ by_point * weighted, seen.points, seen.num_points)
    damping = 1e-6 * of_points.diagonal(dim1=1, dim2=2).mean(dim=1) + 1e-30  # the latter for points without weight
    of_points = of_points + damping[:, None, None] * one
    mixed = by_camera.new_zeros(num_views, 6, seen.num_points, 3)
    mixed[seen.views, :, seen.points] = by_camera.mT @ by_point * weighted
    mixed = mixed.flatten(0, 1)
    eliminated = torch.einsum("cpi,pij->cpj", mixed, torch.linalg.inv(of_points)).flatten(1)
    right = _sums(by_camera.mT @ distances[..., None] * weighted, seen.views, num_views).flatten()
    right_of_points = _sums(by_point.mT @ distances[..., None] * weighted, seen.points, seen.num_points).flatten()
    stiffness = change.new_tensor([_TURN**-2] * 3 + [_SHIFT**-2] * 3).repeat(num_views)
    matrix = torch.block_diag(*of_cameras) - eliminated @ mixed.flatten(1).T + torch.diag(stiffness)
    return matrix, right - eliminated @ right_of_points + stiffness * change.flatten()


def _derivatives(
    seen: Observations,
    extrinsics: Float[Tensor, "view 4 4"],
    unit: Float[Tensor, " view"],
    local: Float[Tensor, "seen 3"],
) -> tuple[Float[Tensor, "seen 2 6"], Float[Tensor, "seen 2 3"]]:
    """Return the derivatives of positions in pixels by the change of the camera, and by the point."""
    depth = _depth(local)
    by_local = local.new_zeros(len(local), 2, 3)
    by_local[:, 0, 0] = by_local[:, 1, 1] = seen.focal_px / depth
    by_local[:, :, 2] = -local[:, :2] * (seen.focal_px / depth**2)[:, None]
    by_point = by_local @ extrinsics[seen.views, :3, :3].mT
    by_shift = -by_point * unit[seen.views, None, None]
    return torch.cat((by_local @ cross_product_matrix(local), by_shift), dim=2), by_point
