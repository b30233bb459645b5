"""Fit degree-1 spherical harmonics to the colours seen from the other views.

A Gaussian is predicted with the colour of its own view. The colour of another view at its projection differs because of
reflections, exposure or an inaccurate depth. A colour that is linear in the viewing direction (degree 1) reproduces
part of the difference: renderings at each view are closer to that view, and renderings between views blend them by
angle (Buehler et al., "Unstructured Lumigraph Rendering", 2001). The fit uses decoded data only and needs no bits.
"""

from dataclasses import replace
from typing import NamedTuple

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.config import ReceiverConfig
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import SH_DEGREE_0, SH_DEGREE_1, Gaussians
from fecocodec.splatting.sampling import SMALLEST_DEPTH, Colours, Points, other_views, project, sample_at


class NormalEquations(NamedTuple):
    """Normal equations `(matrix + ridge^2 I) @ slope = right` of all Gaussians."""

    matrix: Float[Tensor, "view 3 3 h w"]
    right: Float[Tensor, "view 3 3 h w"]


def view_dependent(gaussians: Gaussians, cameras: Cameras, grid: tuple[int, int], config: ReceiverConfig) -> Gaussians:
    """Return the Gaussians of one scene with spherical harmonics of degree 1.

    Each gets its own colour c in its own direction d, plus a fitted slope S (xyz to rgb). It minimises
    sum_j w_j |S^T (d_j - d) - (c_j - c)|^2 + ridge^2 |S|^2 over the other views j; the weight w_j is small where the
    surface of view j occludes the Gaussian. A single view, or Gaussians that already have degree 1 or more, are
    returned unchanged. gaussians: ordered (view, row, column), with `grid` = (height, width) per view, in the frame of
    the cameras.
    """
    if cameras.num_views == 1 or gaussians.harmonics.shape[-2] > 1:
        return gaussians
    sizes = {"v": cameras.num_views, "h": grid[0], "w": grid[1]}
    points = rearrange(gaussians.means, "(v h w) xyz -> v xyz h w", **sizes).contiguous()
    own = 0.5 + SH_DEGREE_0 * rearrange(gaussians.harmonics, "(v h w) 1 rgb -> v rgb h w", **sizes).contiguous()
    surfaces = surfaces_of(points, own, cameras)
    empty = own.new_zeros(len(own), 3, *own.shape[1:])
    equations = NormalEquations(empty, empty)
    for index, there in other_views(cameras):
        equations = with_view(equations, points, own, cameras, surfaces.index_select(0, index), there, config)
    return replace(gaussians, harmonics=harmonics_of(equations, points, own, cameras, config))


def surfaces_of(points: Points, own: Colours, cameras: Cameras) -> Float[Tensor, "view 4 h w"]:
    """Return colour and inverse depth of each Gaussian in its own view. own: sRGB colours."""
    forward, centres = cameras.extrinsics[:, :3, 2], cameras.extrinsics[:, :3, 3]
    depth = ((points - centres[..., None, None]) * forward[..., None, None]).sum(dim=1)
    return torch.cat((own, 1.0 / depth[:, None].clamp_min(SMALLEST_DEPTH)), dim=1)


def with_view(
    equations: NormalEquations,
    points: Points,
    own: Colours,
    cameras: Cameras,
    surfaces: Float[Tensor, "view 4 h w"],
    judges: Cameras,
    config: ReceiverConfig,
) -> NormalEquations:
    """Add another view to the equations of each view. surfaces, judges: `surfaces_of`, cameras of the others."""
    uv, depth, is_seen = project(judges, points)
    there = sample_at(surfaces, uv)
    lag = (there[:, 3] * depth).clamp_min(1e-6).log()
    weight = is_seen * torch.sigmoid((config.hiding_lag - lag) / config.hiding_lag_width)
    turn = _directions(points, judges.extrinsics[:, :3, 3]) - _directions(points, cameras.extrinsics[:, :3, 3])
    weighted = (weight[:, None] * turn)[:, :, None]
    difference = there[:, :3] - own
    matrix = torch.addcmul(equations.matrix, weighted, turn[:, None])
    return NormalEquations(matrix, torch.addcmul(equations.right, weighted, difference[:, None]))


def harmonics_of(
    equations: NormalEquations, points: Points, own: Colours, cameras: Cameras, config: ReceiverConfig
) -> Float[Tensor, "n 4 3"]:
    """Return the harmonics of Gaussians, ordered (view, row, column), whose slopes solve the normal equations."""
    direction = _directions(points, cameras.extrinsics[:, :3, 3])
    slope = config.view_dependence * _solution(equations, config.view_dependence_ridge**2)
    base = (own - 0.5 - (direction[:, :, None] * slope).sum(dim=1)) / SH_DEGREE_0
    x, y, z = (slope / SH_DEGREE_1).unbind(dim=1)
    fitted = torch.stack((base, -y, z, -x), dim=1)
    plain = F.pad(((own - 0.5) / SH_DEGREE_0)[:, None], (0, 0, 0, 0, 0, 0, 0, 3))
    is_placed = fitted.sum(dim=(1, 2)).isfinite()
    return rearrange(torch.where(is_placed[:, None, None], fitted, plain), "v sh rgb h w -> (v h w) sh rgb")


def _solution(equations: NormalEquations, ridge: float) -> Float[Tensor, "view 3 3 h w"]:
    """Solve (matrix + ridge I) X = right for X by Cramer's rule; the matrices are symmetric."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = (row.unbind(dim=1) for row in equations.matrix.unbind(dim=1))
    xx, yy, zz = xx + ridge, yy + ridge, zz + ridge
    of_x = (yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy)
    of_y, of_z = (of_x[1], xx * zz - xz * xz, xy * xz - xx * yz), (of_x[2], xy * xz - xx * yz, xx * yy - xy * xy)
    determinant = xx * of_x[0] + xy * of_x[1] + xz * of_x[2]
    adjugate = torch.stack([torch.stack(row, dim=1) for row in (of_x, of_y, of_z)], dim=1)
    return (adjugate[:, :, :, None] * equations.right[:, None]).sum(dim=2) / determinant[:, None, None]


def _directions(points: Points, centres: Float[Tensor, "view 3"]) -> Points:
    """Return unit vectors to points from one camera centre per view."""
    offset = points - centres[..., None, None]
    return offset * offset.square().sum(dim=1, keepdim=True).clamp_min(SMALLEST_DEPTH**2).rsqrt()
