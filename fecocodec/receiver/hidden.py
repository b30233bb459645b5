"""Visibility test of the background layer: which Gaussians no context view sees and none has reason to miss."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.geometry.rotations import matrix_from_quaternion

SMALLEST_DEPTH = 1e-6
VISIBLE_DEVIATIONS = 3.33  # renderers draw an opaque Gaussian to alpha = 1/255: sqrt(2 ln 255) standard deviations
JACOBIAN_MARGIN = 0.15  # renderers take the projection's Jacobian at most this share of a side outside the image
CLEARANCE = 0.5  # of a view's smallest extended depth: no background nearer to its camera than this


@dataclass(frozen=True)
class ExtendedDepth:
    """Depth of each view on cells that reach beyond its image.

    depth: scene units. centres: of the cells along either axis, in normalised image units, ascending; the image is
    [0, 1]. reach: largest distance from the image at which the depth is used.
    """

    depth: Float[Tensor, "view cell cell"]
    centres: Float[Tensor, " cell"]
    reach: float

    def at(self, view: int, uv: Float[Tensor, "n 2"]) -> Float[Tensor, " n"]:
        """Depth of the nearest cell; 0 beyond `reach`."""
        column, row = torch.bucketize(uv.T.contiguous(), 0.5 * (self.centres[1:] + self.centres[:-1]))
        is_covered = ((uv >= -self.reach) & (uv <= 1.0 + self.reach)).all(dim=-1)
        return self.depth[view, row, column] * is_covered


def is_hidden(gaussians: Gaussians, extended: ExtendedDepth, cameras: Cameras) -> Bool[Tensor, " n"]:
    """Whether a Gaussian is drawn in no view, lies behind the extended depth of all, and is not close to a camera."""
    hidden = torch.ones_like(gaussians.opacities, dtype=torch.bool)
    for view in range(cameras.num_views):
        hidden &= _is_hidden_from(gaussians, extended, cameras, view)
    return hidden


def _is_hidden_from(
    gaussians: Gaussians, extended: ExtendedDepth, cameras: Cameras, view: int
) -> Bool[Tensor, " n"]:
    world_to_camera, intrinsics = cameras.world_to_camera[view], cameras.intrinsics[view]
    points = gaussians.means @ world_to_camera[:3, :3].T + world_to_camera[:3, 3]
    is_in_front = points[:, 2] > SMALLEST_DEPTH
    depth = points[:, 2].clamp_min(SMALLEST_DEPTH)
    uv = points[:, :2] / depth[:, None] * intrinsics.diagonal()[:2] + intrinsics[:2, 2]
    radius = VISIBLE_DEVIATIONS * _deviations(gaussians, world_to_camera, intrinsics, uv, depth)
    is_seen = is_in_front & ((uv > -radius) & (uv < 1.0 + radius)).all(dim=-1)
    is_before = is_in_front & (depth < extended.at(view, uv))
    is_close = points.norm(dim=-1) < CLEARANCE * extended.depth[view].amin()
    return ~(is_seen | is_before | is_close)


def _deviations(
    gaussians: Gaussians,
    world_to_camera: Float[Tensor, "4 4"],
    intrinsics: Float[Tensor, "3 3"],
    uv: Float[Tensor, "n 2"],
    depth: Float[Tensor, " n"],
) -> Float[Tensor, "n 2"]:
    """Standard deviations along u and v of the projected Gaussians, as renderers linearise the projection."""
    axes = world_to_camera[:3, :3] @ matrix_from_quaternion(gaussians.rotations) * gaussians.scales[:, None]
    slope = (uv.clamp(-JACOBIAN_MARGIN, 1.0 + JACOBIAN_MARGIN) - intrinsics[:2, 2]) / intrinsics.diagonal()[:2]
    projected = axes[:, :2] - slope[..., None] * axes[:, 2:]
    return projected.norm(dim=-1) * intrinsics.diagonal()[:2] / depth[:, None]
