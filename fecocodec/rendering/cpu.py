"""Rendering on the CPU, by the kernels of this folder, as one differentiable function."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Float32, Int32
from torch import Tensor
from torch.autograd.function import once_differentiable

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.kernels.threads import run_in_ranges, run_side_by_side
from fecocodec.rendering.compositing import composite
from fecocodec.rendering.compositing_backward import composite_backward
from fecocodec.rendering.projection import project, project_backward
from fecocodec.rendering.rendering import Rendering
from fecocodec.rendering.spherical_harmonics import shade, shade_backward
from fecocodec.rendering.splats import DIFFERENTIABLE_FIELDS, SPLAT, Pinhole, pinholes
from fecocodec.rendering.tiles import TileLists, front_to_back, sum_over_tiles, tile_lists

Images = tuple[np.ndarray, np.ndarray, np.ndarray]  # color [3 height width], depth and alpha [height width], float32


@dataclass(frozen=True)
class _Projected:
    """The visible splats of one camera and the order, front to back, in which they are composited.

    gaussian_of_splat: indices of their Gaussians, ascending. whole: lists that cover the image; None if they have not
    been made, or if several are needed.
    """

    pinhole: Pinhole
    splats: np.ndarray
    gaussian_of_splat: Int32[np.ndarray, " visible"]
    order: Int32[np.ndarray, " visible"]
    whole: TileLists | None = None

    def lists(self, image_size: tuple[int, int]) -> Iterable[TileLists]:
        """Return lists that cover the image, made anew unless they are kept."""
        return [self.whole] if self.whole is not None else tile_lists(self.splats, self.order, image_size)


def render_on_cpu(
    gaussians: Gaussians,
    cameras: Cameras,
    image_size: tuple[int, int],
    background: tuple[float, float, float],
    near: float,
) -> Rendering:
    """Render as `rasterizer.render` does. near: Gaussians whose mean is closer than this depth are not drawn."""
    fields = [field.to(torch.float32) for field in gaussians.fields()]
    return Rendering(*_Rasterize.apply(*fields, pinholes(cameras, image_size, near), image_size, background))


class _Rasterize(torch.autograd.Function):
    """(means, scales, rotations, opacities, harmonics, pinholes, image_size, background) -> (color, depth, alpha)."""

    @staticmethod
    def forward(ctx: Any, *inputs: Any) -> tuple[Tensor, Tensor, Tensor]:
        *fields, cameras, (height, width), background = inputs
        arrays = [_array(field) for field in fields]
        color = fields[0].new_empty(len(cameras), 3, height, width)
        depth, alpha = color.new_empty(len(cameras), height, width), color.new_empty(len(cameras), height, width)
        needs_gradients = any(ctx.needs_input_grad)

        def draw(view: int) -> _Projected | None:
            seen = _project(cameras[view], arrays)
            images = (_array(color[view]), _array(depth[view]), _array(alpha[view]))
            whole = _composite(seen, np.asarray(background, np.float32), images)
            # Without gradients, splats are not kept: they are larger than the images.
            return replace(seen, whole=whole) if needs_gradients else None

        ctx.projected = run_side_by_side(draw, len(cameras))
        ctx.save_for_backward(*fields, color, depth, alpha)
        return color, depth, alpha

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, d_color: Tensor, d_depth: Tensor, d_alpha: Tensor) -> tuple[Tensor | None, ...]:
        *fields, color, depth, alpha = ctx.saved_tensors
        arrays = [_array(field) for field in fields]

        def splat_gradients(view: int) -> np.ndarray:
            images = (_array(color[view]), _array(depth[view]), _array(alpha[view]))
            d_images = (_array(d_color[view]), _array(d_depth[view]), _array(d_alpha[view]))
            return _composite_backward(ctx.projected[view], images, d_images)

        gradients = [torch.zeros_like(field, memory_format=torch.contiguous_format) for field in fields]
        of_views = run_side_by_side(splat_gradients, len(ctx.projected))
        for projected, of_splats in zip(ctx.projected, of_views, strict=True):
            _project_backward(projected, arrays, of_splats, [_array(gradient) for gradient in gradients])
        return *gradients, None, None, None


def _array(tensor: Float[Tensor, "*shape"]) -> Float32[np.ndarray, "*shape"]:
    """Return the values as a contiguous array, which shares memory with a contiguous tensor."""
    return tensor.detach().contiguous().numpy()


def _project(pinhole: Pinhole, fields: Sequence[np.ndarray]) -> _Projected:
    means, scales, rotations, opacities, harmonics = fields
    splats, indices = np.empty(len(means), SPLAT), np.full(len(means), -1, np.int32)
    run_in_ranges(project, len(means), pinhole, means, scales, rotations, opacities, splats, indices)
    visible = np.flatnonzero(indices >= 0)
    splats, indices = splats.take(visible), indices[visible]
    run_in_ranges(shade, len(splats), pinhole.eye, means, harmonics, indices, splats)
    return _Projected(pinhole, splats, indices, front_to_back(splats))


def _composite(projected: _Projected, background: Float32[np.ndarray, "3"], images: Images) -> TileLists | None:
    """Write the images. Returns the lists of splats if they cover the image at once."""
    whole = None
    for tiles in projected.lists(images[-1].shape):
        lists = (tiles.first, tiles.offsets, tiles.splat_of_hit)
        run_in_ranges(composite, tiles.stop - tiles.first, *lists, projected.splats, background, *images)
        whole = tiles if tiles.first == 0 else None
    return whole


def _composite_backward(
    projected: _Projected, images: Images, d_images: Images
) -> Float32[np.ndarray, "visible fields"]:
    splats = projected.splats
    gradients = np.zeros((len(splats), len(DIFFERENTIABLE_FIELDS)), np.float32)
    for tiles in projected.lists(images[-1].shape):
        lists = (tiles.first, tiles.offsets, tiles.splat_of_hit)
        hit_gradients = np.empty((len(tiles.splat_of_hit), len(DIFFERENTIABLE_FIELDS)), np.float32)
        run_in_ranges(composite_backward, tiles.stop - tiles.first, *lists, splats, images, d_images, hit_gradients)
        sum_over_tiles(tiles, hit_gradients, gradients)
    return gradients


def _project_backward(
    projected: _Projected,
    fields: Sequence[np.ndarray],
    splat_gradients: Float32[np.ndarray, "visible fields"],
    gradients: Sequence[np.ndarray],
) -> None:
    """Add the gradients from one view to those of means, scales, rotations, opacities and harmonics."""
    means, scales, rotations, _, harmonics = fields
    d_means, *d_shapes, d_harmonics = gradients
    pinhole, splats, indices = projected.pinhole, projected.splats, projected.gaussian_of_splat
    geometry, colours = (means, scales, rotations, indices), (means, harmonics, indices, splats)
    run_in_ranges(project_backward, len(splats), pinhole, *geometry, splat_gradients, d_means, *d_shapes)
    run_in_ranges(shade_backward, len(splats), pinhole.eye, *colours, splat_gradients, d_means, d_harmonics)
