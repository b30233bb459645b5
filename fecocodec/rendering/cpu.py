"""Rendering on the CPU: the kernels of this folder as one differentiable function."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Float32, Int32
from torch import Tensor
from torch.autograd.function import once_differentiable

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.rendering.compositing import composite, composite_backward
from fecocodec.rendering.projection import project, project_backward
from fecocodec.rendering.rendering import Rendering
from fecocodec.rendering.spherical_harmonics import shade, shade_backward
from fecocodec.rendering.splats import DIFFERENTIABLE_FIELDS, SPLAT, Pinhole, Vector3
from fecocodec.rendering.threads import run_in_ranges
from fecocodec.rendering.tiles import TileGrid, front_to_back, sum_over_tiles, tile_lists


@dataclass(frozen=True)
class _View:
    """A camera, the background behind it and, once projected, the splats it sees."""

    pinhole: Pinhole
    eye: Vector3
    grid: TileGrid


@dataclass(frozen=True)
class _Projected:
    """The splats of one view and the order in which they are composited."""

    splats: np.ndarray
    order: Int32[np.ndarray, " visible"]


def render_on_cpu(
    gaussians: Gaussians,
    cameras: Cameras,
    image_size: tuple[int, int],
    background: tuple[float, float, float],
    near: float,
) -> Rendering:
    """See `rasterizer.render`. near: Gaussians whose mean is closer than this depth are not drawn."""
    views = _views(cameras, image_size, near)
    fields = [field.to(torch.float32) for field in gaussians.fields()]
    return Rendering(*_Rasterize.apply(*fields, views, np.asarray(background, np.float32)))


def _views(cameras: Cameras, image_size: tuple[int, int], near: float) -> list[_View]:
    height, width = image_size
    grid = TileGrid(height, width)
    views = []
    for pose, world_to_camera, intrinsics in zip(
        cameras.extrinsics.detach().double().tolist(),
        cameras.world_to_camera.detach().double().tolist(),
        cameras.intrinsics_px(height, width).detach().double().tolist(),
        strict=True,
    ):
        pinhole = Pinhole(
            rotation=tuple(tuple(row[:3]) for row in world_to_camera[:3]),
            translation=tuple(row[3] for row in world_to_camera[:3]),
            focal_x=intrinsics[0][0],
            focal_y=intrinsics[1][1],
            centre_x=intrinsics[0][2],
            centre_y=intrinsics[1][2],
            width=width,
            height=height,
            near=near,
        )
        views.append(_View(pinhole, tuple(row[3] for row in pose[:3]), grid))
    return views


class _Rasterize(torch.autograd.Function):
    """(means, scales, rotations, opacities, harmonics, views, background) -> (color, depth, alpha), all float32."""

    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> tuple[Tensor, Tensor, Tensor]:
        *fields, views, background = inputs
        arrays = [_array(field) for field in fields]
        height, width = (views[0].grid.height, views[0].grid.width) if views else (0, 0)
        color = torch.empty(len(views), 3, height, width)
        depth = torch.empty(len(views), height, width)
        alpha = torch.empty(len(views), height, width)
        projected = []
        for index, view in enumerate(views):
            projected.append(_project(view, arrays))
            images = tuple(image[index].numpy() for image in (color, depth, alpha))
            _composite(view, projected[-1], background, images)
        ctx.save_for_backward(*fields, color, depth, alpha)
        ctx.views, ctx.projected = views, projected
        return color, depth, alpha

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *output_gradients: Tensor) -> tuple[Tensor | None, ...]:
        *fields, color, depth, alpha = ctx.saved_tensors
        arrays = [_array(field) for field in fields]
        gradients = [torch.zeros(field.shape) for field in fields]
        for index, (view, projected) in enumerate(zip(ctx.views, ctx.projected, strict=True)):
            images = [_array(image[index]) for image in (color, depth, alpha, *output_gradients)]
            splat_gradients = _composite_backward(view, projected, images)
            _project_backward(view, projected, arrays, splat_gradients, [gradient.numpy() for gradient in gradients])
        return *gradients, None, None


def _array(tensor: Float[Tensor, "*shape"]) -> Float32[np.ndarray, "*shape"]:
    return tensor.detach().contiguous().numpy()


def _project(view: _View, fields: Sequence[np.ndarray]) -> _Projected:
    means, scales, rotations, opacities, harmonics = fields
    splats = np.empty(len(means), SPLAT)
    run_in_ranges(project, len(means), view.pinhole, means, scales, rotations, opacities, splats)
    run_in_ranges(shade, len(means), view.eye, means, harmonics, splats)
    return _Projected(splats, front_to_back(splats))


def _composite(
    view: _View, projected: _Projected, background: Float32[np.ndarray, "3"], images: tuple[np.ndarray, ...]
) -> None:
    for lists in tile_lists(view.grid, projected.splats, projected.order):
        tiles = (lists.first, lists.offsets, lists.splat_of_hit)
        run_in_ranges(composite, lists.stop - lists.first, *tiles, projected.splats, background, *images)


def _composite_backward(
    view: _View, projected: _Projected, images: Sequence[np.ndarray]
) -> Float32[np.ndarray, "n fields"]:
    """images: color, depth, alpha and their gradients."""
    gradients = np.zeros((len(projected.splats), len(DIFFERENTIABLE_FIELDS)), np.float32)
    for lists in tile_lists(view.grid, projected.splats, projected.order):
        tiles = (lists.first, lists.offsets, lists.splat_of_hit)
        hit_gradients = np.empty((len(lists.splat_of_hit), len(DIFFERENTIABLE_FIELDS)), np.float32)
        run_in_ranges(composite_backward, lists.stop - lists.first, *tiles, projected.splats, *images, hit_gradients)
        sum_over_tiles(lists, hit_gradients, gradients)
    return gradients


def _project_backward(
    view: _View,
    projected: _Projected,
    fields: Sequence[np.ndarray],
    splat_gradients: Float32[np.ndarray, "n fields"],
    gradients: Sequence[np.ndarray],
) -> None:
    """Add this view's share to the gradients of means, scales, rotations, opacities and harmonics."""
    means, scales, rotations, _, harmonics = fields
    d_means, *d_shapes, d_harmonics = gradients
    splats, count = projected.splats, len(means)
    run_in_ranges(
        project_backward, count, view.pinhole, means, scales, rotations, splats, splat_gradients, d_means, *d_shapes
    )
    run_in_ranges(shade_backward, count, view.eye, means, harmonics, splats, splat_gradients, d_means, d_harmonics)
