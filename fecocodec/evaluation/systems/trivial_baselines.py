"""Trivial baselines without learning: the nearest context view, and both context views warped by one plane."""

from time import perf_counter

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from fecocodec.evaluation.systems.reconstruction import Reconstruction, System
from fecocodec.geometry.cameras import camera_to_world_points, pixel_rays
from fecocodec.geometry.views import Views

NEAREST = "nearest view"
NUM_PLANES = 48


def trivial_baselines() -> tuple[System, ...]:
    """Return the trivial baselines. They transmit nothing: num_bytes is 0."""
    return (System(NEAREST, "copied", _nearest), System("best plane", "oracle", _best_plane))


def _nearest(views: Views, num_context: int) -> Reconstruction:
    """Return, for each camera, a copy of the context view with the nearest camera centre."""
    begin = perf_counter()
    centres = views.cameras.extrinsics[:, :3, 3]
    nearest = torch.cdist(centres, centres[:num_context]).argmin(dim=1)
    return Reconstruction(0, 0.0, perf_counter() - begin, None, views.images[:num_context][nearest], None)


def _best_plane(views: Views, num_context: int) -> Reconstruction:
    """Return, for each camera, the mean of the context views warped by the best fronto-parallel plane.

    The plane is chosen with the ground truth of each view, which gives an upper bound for a single plane.
    """
    begin = perf_counter()
    near, far = float(views.cameras.near), float(views.cameras.far)
    depths = 1.0 / torch.linspace(1.0 / near, 1.0 / far, NUM_PLANES)
    images = [_best_warp(views, view, num_context, depths) for view in range(len(views.images))]
    return Reconstruction(0, 0.0, perf_counter() - begin, None, torch.stack(images), None)


def _best_warp(
    views: Views, view: int, num_context: int, depths: Float[Tensor, " plane"]
) -> Float[Tensor, "3 height width"]:
    warps = torch.stack([_warp(views, view, num_context, float(depth)) for depth in depths])
    return warps[(warps - views.images[view]).square().mean(dim=(1, 2, 3)).argmin()]


def _warp(views: Views, view: int, num_context: int, depth: float) -> Float[Tensor, "3 height width"]:
    """Warp the context views by a plane; mean over the views that see a point, or over clamped samples if none does."""
    cameras = views.cameras
    points = camera_to_world_points(
        cameras.select([view]), depth * pixel_rays(cameras.select([view]), *views.image_size)
    )
    sources = list(range(num_context))
    projection = cameras.select(sources).project(points[0])
    grid = 2 * projection.uv - 1
    seen = F.grid_sample(views.images[sources], grid, padding_mode="border", align_corners=False)
    weight = projection.is_visible.float()[:, None] + 1e-4
    return (weight * seen).sum(dim=0) / weight.sum(dim=0)
