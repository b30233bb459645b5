"""Visibility test of the background layer: find the Gaussians that no context view renders."""

import torch
from einops import rearrange
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.rotations import matrix_from_quaternion
from fecocodec.splatting.sampling import SMALLEST_DEPTH

VISIBLE_DEVIATIONS = 3.2  # radius of a Gaussian; alpha is 0.6% there
JACOBIAN_MARGIN = 0.15  # renderers evaluate the projection's Jacobian at most this share of a side outside the image
DEPTH_REACH = 0.5  # as a share of a side: distance outside the image up to which extended depth is used
CLEARANCE = 0.5  # minimum distance from a camera, as a share of its view's smallest extended depth


def is_hidden(
    gaussians: Gaussians, extended: Float[Tensor, "view cell cell"], centres: Float[Tensor, " cell"], cameras: Cameras
) -> Bool[Tensor, " n"]:
    """Return which Gaussians are outside every image, behind the extended depth of every view, and near no camera.

    extended: depth of each view, extrapolated to cells outside its image. centres: of the cells along either axis, in
    normalised image units, ascending; the image is [0, 1].
    """
    means, axes = gaussians.means.T.contiguous(), standard_deviations(gaussians)
    hidden, bounds = torch.ones_like(gaussians.opacities, dtype=torch.bool), bounds_of(centres)
    for of_view in zip(extended, cameras.world_to_camera, cameras.intrinsics, strict=True):
        hidden = hidden & is_hidden_from(means, axes, bounds, *of_view)
    return hidden


def bounds_of(centres: Float[Tensor, " cell"]) -> Float[Tensor, " bound"]:
    """Return the limits between cells along either axis."""
    return 0.5 * (centres[1:] + centres[:-1])


def standard_deviations(gaussians: Gaussians) -> Float[Tensor, "own 3 n"]:
    """Return the axes of Gaussians, one standard deviation long, in the frame of their means."""
    axes = matrix_from_quaternion(gaussians.rotations) * gaussians.scales[:, None]
    return rearrange(axes, "n xyz own -> own xyz n").contiguous()


def is_hidden_from(
    means: Float[Tensor, "3 n"],
    axes: Float[Tensor, "own 3 n"],
    bounds: Float[Tensor, " bound"],
    extended: Float[Tensor, "cell cell"],
    world_to_camera: Float[Tensor, "4 4"],
    intrinsics: Float[Tensor, "3 3"],
) -> Bool[Tensor, " n"]:
    """Return `is_hidden` for one view. axes: of `standard_deviations`."""
    points, is_in_front, depth, uv = projected(means, world_to_camera, intrinsics)
    radius = VISIBLE_DEVIATIONS * _deviations(world_to_camera[:3, :3] @ axes, intrinsics, uv, depth)
    is_seen = is_in_front & ((uv > -radius) & (uv < 1.0 + radius)).all(dim=0)
    is_before = is_in_front & (depth < _extended_depth_at(extended, bounds, uv))
    is_close = points.square().sum(dim=0).sqrt() < CLEARANCE * extended.amin(dim=(0, 1))
    return ~(is_seen | is_before | is_close)


def projected(
    means: Float[Tensor, "3 n"], world_to_camera: Float[Tensor, "4 4"], intrinsics: Float[Tensor, "3 3"]
) -> tuple[Float[Tensor, "3 n"], Bool[Tensor, " n"], Float[Tensor, " n"], Float[Tensor, "2 n"]]:
    """Return points in the camera frame, whether they are in front, their depths, and normalised image positions.

    Coordinates are the first dimension, because it is several times as fast as the last.
    """
    points = world_to_camera[:3, :3] @ means + world_to_camera[:3, 3:]
    is_in_front = points[2] > SMALLEST_DEPTH
    depth = points[2].clamp_min(SMALLEST_DEPTH)
    uv = points[:2] / depth * intrinsics.diagonal()[:2, None] + intrinsics[:2, 2:]
    return points, is_in_front, depth, uv


def _extended_depth_at(
    extended: Float[Tensor, "cell cell"], bounds: Float[Tensor, " bound"], uv: Float[Tensor, "2 n"]
) -> Float[Tensor, " n"]:
    """Return the depth of the nearest cell; 0 at more than DEPTH_REACH outside the image."""
    column, row = (uv[..., None] > bounds).sum(dim=-1)
    is_covered = ((uv >= -DEPTH_REACH) & (uv <= 1.0 + DEPTH_REACH)).all(dim=0)
    return extended.flatten().index_select(0, row * extended.shape[1] + column) * is_covered


def _deviations(
    axes: Float[Tensor, "own 3 n"],
    intrinsics: Float[Tensor, "3 3"],
    uv: Float[Tensor, "2 n"],
    depth: Float[Tensor, " n"],
) -> Float[Tensor, "2 n"]:
    """Return the standard deviations along u and v of projected Gaussians, with the linearisation of renderers.

    axes: in the camera frame.
    """
    focal = intrinsics.diagonal()[:2, None]
    slope = (uv.clamp(-JACOBIAN_MARGIN, 1.0 + JACOBIAN_MARGIN) - intrinsics[:2, 2:]) / focal
    projected = axes[:, :2] - slope * axes[:, 2:]
    return projected.square().sum(dim=0).sqrt() * focal / depth
