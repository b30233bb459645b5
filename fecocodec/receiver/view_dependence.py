"""Fit degree-1 spherical harmonics to the colours seen from the other views.

A Gaussian is predicted with the colour of its own view. The colour of another view at its projection differs because of
reflections, exposure or an inaccurate depth. A colour that is linear in the viewing direction (degree 1) reproduces
part of the difference: renderings at each view are closer to that view, and renderings between views blend them by
angle (Buehler et al., "Unstructured Lumigraph Rendering", 2001). The fit uses decoded data only and needs no bits.
"""

from dataclasses import replace

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.config import ReceiverConfig
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import SH_DEGREE_0, SH_DEGREE_1, Gaussians
from fecocodec.receiver.sampling import SMALLEST_DEPTH, project, sample_at


def view_dependent(gaussians: Gaussians, cameras: Cameras, grid: tuple[int, int], config: ReceiverConfig) -> Gaussians:
    """Return the Gaussians of one scene with spherical harmonics of degree 1.

    A single view, or Gaussians that already have degree 1 or more, are returned unchanged.

    gaussians: ordered (view, row, column), with `grid` = (height, width) per view, in the frame of the cameras.
    """
    views = cameras.num_views
    if views == 1 or gaussians.harmonics.shape[-2] > 1:
        return gaussians
    points = rearrange(gaussians.means, "(v h w) xyz -> v xyz h w", v=views, h=grid[0]).contiguous()
    colour = rearrange(gaussians.harmonics, "(v h w) 1 rgb -> v rgb h w", v=views, h=grid[0]).contiguous()
    colour = 0.5 + SH_DEGREE_0 * colour
    forward, centres = cameras.extrinsics[:, :3, 2], cameras.extrinsics[:, :3, 3]
    depth = ((points - centres[..., None, None]) * forward[..., None, None]).sum(dim=1)
    surfaces = torch.cat((colour, 1.0 / depth[:, None].clamp_min(SMALLEST_DEPTH)), dim=1)
    harmonics = torch.stack([_harmonics(view, points[view], surfaces, cameras, config) for view in range(views)])
    return replace(gaussians, harmonics=rearrange(harmonics, "v sh rgb h w -> (v h w) sh rgb"))


def _harmonics(
    view: int,
    points: Float[Tensor, "3 h w"],
    surfaces: Float[Tensor, "view 4 h w"],
    cameras: Cameras,
    config: ReceiverConfig,
) -> Float[Tensor, "4 3 h w"]:
    """Return the harmonics of one view's Gaussians: their own colour in their own direction d, plus a fitted slope.

    The slope S (xyz to rgb) minimises sum_j w_j |S^T (d_j - d) - (c_j - c)|^2 + ridge^2 |S|^2 over the other views j.
    The weight w_j is small where the surface of view j occludes the Gaussian. points: in the world frame. surfaces:
    sRGB colour and inverse depth of each view.
    """
    own, centres = surfaces[view, :3], cameras.extrinsics[:, :3, 3]
    direction = _directions(points, centres[view])
    ridge = config.view_dependence_ridge**2 * torch.eye(3, device=own.device)
    matrix = ridge[..., None, None].repeat(1, 1, *own.shape[1:])
    right = torch.zeros_like(matrix)
    for other in range(cameras.num_views):
        if other == view:
            continue
        uv, depth, is_seen = project(cameras.select([other]), points)
        there = sample_at(surfaces[other], uv)
        lag = (there[3] * depth).clamp_min(1e-6).log()
        weight = is_seen * torch.sigmoid((config.hiding_lag - lag) / config.hiding_lag_width)
        turn = _directions(points, centres[other]) - direction
        weighted = (weight * turn)[:, None]
        matrix.addcmul_(weighted, turn)
        right.addcmul_(weighted, there[:3] - own)
    slope = config.view_dependence * _solution(matrix, right)
    base = (own - 0.5 - (direction[:, None] * slope).sum(dim=0)) / SH_DEGREE_0
    x, y, z = slope / SH_DEGREE_1
    fitted = torch.stack((base, -y, z, -x))
    plain = F.pad(((own - 0.5) / SH_DEGREE_0)[None], (0, 0, 0, 0, 0, 0, 0, 3))
    is_placed = fitted.sum(dim=(0, 1)).isfinite()
    return torch.where(is_placed, fitted, plain)


def _solution(matrix: Float[Tensor, "3 3 h w"], right: Float[Tensor, "3 3 h w"]) -> Float[Tensor, "3 3 h w"]:
    """Solve matrix X = right for X by Cramer's rule; the matrices are symmetric."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = matrix
    of_x = (yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy)
    of_y, of_z = (of_x[1], xx * zz - xz * xz, xy * xz - xx * yz), (of_x[2], xy * xz - xx * yz, xx * yy - xy * xy)
    determinant = xx * of_x[0] + xy * of_x[1] + xz * of_x[2]
    adjugate = torch.stack([torch.stack(row) for row in (of_x, of_y, of_z)])
    return (adjugate[:, :, None] * right).sum(dim=1) / determinant


def _directions(points: Float[Tensor, "3 h w"], centre: Float[Tensor, "3"]) -> Float[Tensor, "3 h w"]:
    """Return unit vectors from a camera centre to points."""
    offset = points - centre[:, None, None]
    return offset * offset.square().sum(dim=0).clamp_min(SMALLEST_DEPTH**2).rsqrt()
