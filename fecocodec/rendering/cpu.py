"""Rendering on the CPU, by the kernels of this folder, as one differentiable function."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Float32, Float64, Int32
from torch import Tensor
from torch.autograd.function import once_differentiable

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.kernels.threads import run_in_ranges, run_side_by_side
from fecocodec.rendering.compositing import composite
from fecocodec.rendering.compositing_backward import composite_backward
from fecocodec.rendering.projection import covariances_backward, covariances_of, cutoffs_of, project, project_backward
from fecocodec.rendering.spherical_harmonics import shade, shade_backward
from fecocodec.rendering.splats import DIFFERENTIABLE_FIELDS, SPLAT, Pinhole, pinholes
from fecocodec.rendering.tiles import TileLists, front_to_back, sum_hits, tile_lists

Images = tuple[np.ndarray, np.ndarray, np.ndarray]  # color [3 height width], depth and alpha [height width], float32


@dataclass(frozen=True)
class Rendering:
    """Images of Gaussians, with blending weights w.

    color: sRGB, at least 0, over the background. depth: expected depth sum(w z) / sum(w) along the optical axis in
    scene units, 0 where no Gaussian is drawn. alpha: accumulated opacity sum(w) in [0, 1].
    """

    color: Float[Tensor, "view 3 height width"]
    depth: Float[Tensor, "view height width"]
    alpha: Float[Tensor, "view height width"]


@dataclass(frozen=True)
class _Measured:
    """Gaussians, with what is the same for all cameras: covariances and cutoffs as `projection` takes them."""

    means: Float32[np.ndarray, "n 3"]
    opacities: Float32[np.ndarray, " n"]
    harmonics: Float32[np.ndarray, "n coefficients 3"]
    covariances: Float64[np.ndarray, "n 6"]
    cutoffs: Float64[np.ndarray, " n"]


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
        gaussians = _measured(*(_array(field) for field in fields))
        color = fields[0].new_empty(len(cameras), 3, height, width)
        depth, alpha = color.new_empty(len(cameras), height, width), color.new_empty(len(cameras), height, width)
        needs_gradients = any(ctx.needs_input_grad)

        def draw(view: int) -> _Projected | None:
            seen = _project(cameras[view], gaussians)
            images = (_array(color[view]), _array(depth[view]), _array(alpha[view]))
            whole = _composite(seen, np.asarray(background, np.float32), images)
            # Without gradients, splats are not kept: they are larger than the images.
            return replace(seen, whole=whole) if needs_gradients else None

        ctx.gaussians = gaussians if needs_gradients else None
        ctx.projected = run_side_by_side(draw, len(cameras))
        ctx.save_for_backward(*fields, color, depth, alpha)
        return color, depth, alpha

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, d_color: Tensor, d_depth: Tensor, d_alpha: Tensor) -> tuple[Tensor | None, ...]:
        *fields, color, depth, alpha = ctx.saved_tensors

        def splat_gradients(view: int) -> np.ndarray:
            images = (_array(color[view]), _array(depth[view]), _array(alpha[view]))
            d_images = (_array(d_color[view]), _array(d_depth[view]), _array(d_alpha[view]))
            return _composite_backward(ctx.projected[view], images, d_images)

        gradients = [torch.zeros_like(field, memory_format=torch.contiguous_format) for field in fields]
        d_means, d_scales, d_rotations, d_opacities, d_harmonics = (_array(gradient) for gradient in gradients)
        d_covariances = np.zeros_like(ctx.gaussians.covariances)
        of_views = run_side_by_side(splat_gradients, len(ctx.projected))
        for projected, of_splats in zip(ctx.projected, of_views, strict=True):
            targets = (d_means, d_covariances, d_opacities, d_harmonics)
            _project_backward(projected, ctx.gaussians, of_splats, *targets)
        shapes = (_array(fields[1]), _array(fields[2]), d_covariances)
        run_in_ranges(covariances_backward, len(d_covariances), *shapes, d_scales, d_rotations)
        return *gradients, None, None, None


def _array(tensor: Float[Tensor, "*shape"]) -> Float32[np.ndarray, "*shape"]:
    """Return the values as a contiguous array, which shares memory with a contiguous tensor."""
    return tensor.detach().contiguous().numpy()


def _measured(
    means: np.ndarray, scales: np.ndarray, rotations: np.ndarray, opacities: np.ndarray, harmonics: np.ndarray
) -> _Measured:
    covariances = np.empty((len(means), 6))
    run_in_ranges(covariances_of, len(means), scales, rotations, covariances)
    return _Measured(means, opacities, harmonics, covariances, cutoffs_of(opacities))


def _project(pinhole: Pinhole, gaussians: _Measured) -> _Projected:
    means = gaussians.means
    splats, indices = np.empty(len(means), SPLAT), np.full(len(means), -1, np.int32)
    shapes = (gaussians.covariances, gaussians.opacities, gaussians.cutoffs)
    run_in_ranges(project, len(means), pinhole, means, *shapes, splats, indices)
    visible = np.flatnonzero(indices >= 0)
    splats, indices = splats.take(visible), indices[visible]
    run_in_ranges(shade, len(splats), pinhole.eye, means, gaussians.harmonics, indices, splats)
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
        sum_hits(tiles.splat_of_hit, hit_gradients, gradients)
    return gradients


def _project_backward(
    projected: _Projected,
    gaussians: _Measured,
    splat_gradients: Float32[np.ndarray, "visible fields"],
    d_means: Float32[np.ndarray, "n 3"],
    d_covariances: Float64[np.ndarray, "n 6"],
    d_opacities: Float32[np.ndarray, " n"],
    d_harmonics: Float32[np.ndarray, "n coefficients 3"],
) -> None:
    """Add the gradients from one view to those of the Gaussians."""
    pinhole, splats, indices = projected.pinhole, projected.splats, projected.gaussian_of_splat
    geometry = (gaussians.means, gaussians.covariances, indices, splat_gradients)
    run_in_ranges(project_backward, len(splats), pinhole, *geometry, d_means, d_covariances, d_opacities)
    colours = (gaussians.means, gaussians.harmonics, indices, splats, splat_gradients)
    run_in_ranges(shade_backward, len(splats), pinhole.eye, *colours, d_means, d_harmonics)
