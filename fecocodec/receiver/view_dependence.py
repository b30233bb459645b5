"""Colours that lean, seen from another view, towards what that view shows there.

A Gaussian has the colour of the pixel it was placed on. Seen from another view it covers what that view shows, which
differs: by reflections, by exposure, or because its depth is a little wrong. A colour linear in the direction
(spherical harmonics of degree 1) goes part of the way between the two: from each view the scene looks more like that
view, and from between them like both, as where pictures are blended by angle (Buehler et al., "Unstructured Lumigraph
Rendering", 2001). The receiver knows all that this needs; it costs no bits.
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
    """The Gaussians of one scene with spherical harmonics of degree 1; as they are where there is a single view, or
    where their colours depend on the direction already.

    gaussians: of whole views with `grid` = (height, width) of them each, ordered (view, row, column).
    """
    views = cameras.num_views
    if views == 1 or gaussians.harmonics.shape[-2] > 1:
        return gaussians
    places = rearrange(gaussians.means, "(v h w) xyz -> v xyz h w", v=views, h=grid[0]).contiguous()
    colour = rearrange(gaussians.harmonics, "(v h w) 1 rgb -> v rgb h w", v=views, h=grid[0]).contiguous()
    colour = 0.5 + SH_DEGREE_0 * colour
    forward, centres = cameras.extrinsics[:, :3, 2], cameras.extrinsics[:, :3, 3]
    depth = ((places - centres[..., None, None]) * forward[..., None, None]).sum(dim=1)
    shown = torch.cat((colour, 1.0 / depth[:, None].clamp_min(SMALLEST_DEPTH)), dim=1)
    harmonics = torch.stack([_harmonics(view, places[view], shown, cameras, config) for view in range(views)])
    return replace(gaussians, harmonics=rearrange(harmonics, "v sh rgb h w -> (v h w) sh rgb"))


def _harmonics(
    view: int,
    places: Float[Tensor, "3 h w"],
    shown: Float[Tensor, "view 4 h w"],
    cameras: Cameras,
    config: ReceiverConfig,
) -> Float[Tensor, "4 3 h w"]:
    """Of one view's Gaussians: their own colour along their own direction, and a slope fitted to the other views.

    The slope by direction S (xyz to rgb) minimises sum_j w_j |S^T (d_j - d) - (c_j - c)|^2 + ridge^2 |S|^2; w_j falls
    where what view j shows hides the Gaussian. shown: colour and inverse depth.
    """
    own, centres = shown[view, :3], cameras.extrinsics[:, :3, 3]
    direction = _directions(places, centres[view])
    ridge = config.view_dependence_ridge**2 * torch.eye(3, device=own.device)
    matrix = ridge[..., None, None].repeat(1, 1, *own.shape[1:])
    right = torch.zeros_like(matrix)
    for other in range(cameras.num_views):
        if other == view:
            continue
        uv, depth, is_seen = project(cameras.select([other]), places)
        there = sample_at(shown[other], uv)
        lag = (there[3] * depth).clamp_min(1e-6).log()
        weight = is_seen * torch.sigmoid((config.hiding_lag - lag) / config.hiding_lag_width)
        turn = _directions(places, centres[other]) - direction
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
    """X in matrix X = right by Cramer's rule, of symmetric matrices."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = matrix
    of_x = (yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy)
    of_y, of_z = (of_x[1], xx * zz - xz * xz, xy * xz - xx * yz), (of_x[2], xy * xz - xx * yz, xx * yy - xy * xy)
    determinant = xx * of_x[0] + xy * of_x[1] + xz * of_x[2]
    adjugate = torch.stack([torch.stack(row) for row in (of_x, of_y, of_z)])
    return (adjugate[:, :, None] * right).sum(dim=1) / determinant


def _directions(places: Float[Tensor, "3 h w"], centre: Float[Tensor, "3"]) -> Float[Tensor, "3 h w"]:
    """Unit vectors from a camera's centre to the places."""
    offset = places - centre[:, None, None]
    return offset * offset.square().sum(dim=0).clamp_min(SMALLEST_DEPTH**2).rsqrt()
