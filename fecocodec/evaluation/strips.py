"""Side-by-side pictures: target, decoded, error, depth; one row a target view."""

import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.evaluation.systems.reconstruction import Reconstruction
from fecocodec.geometry.views import Views

ERROR_GAIN = 4.0  # a difference of a quarter of the range is drawn in the last colour
MAX_ROWS = 4
# Viridis at nine even steps (van der Walt and Smith, 2015), sRGB.
_VIRIDIS = (
    (0.267, 0.005, 0.329),
    (0.279, 0.175, 0.483),
    (0.230, 0.322, 0.546),
    (0.173, 0.449, 0.558),
    (0.128, 0.567, 0.551),
    (0.158, 0.684, 0.502),
    (0.369, 0.789, 0.383),
    (0.678, 0.864, 0.190),
    (0.993, 0.906, 0.144),
)


def strip(views: Views, num_context: int, found: Reconstruction) -> Float[Tensor, "3 height width"]:
    """The first target views, sRGB in [0, 1]; depth as disparity between far (dark) and near (bright)."""
    stop = min(len(views.images), num_context + MAX_ROWS)
    rows = []
    for view in range(num_context, stop):
        error = (found.images[view] - views.images[view]).abs().mean(dim=0) * ERROR_GAIN
        panels = [views.images[view], found.images[view], in_colour(error)]
        if found.depth is not None:
            panels.append(in_colour(_relative_disparity(found.depth[view], views)))
        rows.append(torch.cat(panels, dim=2))
    return torch.cat(rows, dim=1)


def in_colour(values: Float[Tensor, "height width"]) -> Float[Tensor, "3 height width"]:
    """Values in [0, 1] as viridis colours."""
    table = torch.tensor(_VIRIDIS)
    position = values.clamp(0, 1) * (len(table) - 1)
    left = position.long().clamp_max(len(table) - 2)
    part = (position - left)[..., None]
    return rearrange((1 - part) * table[left] + part * table[left + 1], "h w rgb -> rgb h w")


def _relative_disparity(depth: Float[Tensor, "height width"], views: Views) -> Float[Tensor, "height width"]:
    """0 at far and where nothing was rendered, 1 at near."""
    near, far = 1 / views.cameras.near, 1 / views.cameras.far
    disparity = torch.where(depth > 0, 1 / depth.clamp_min(1e-12), far)
    return (disparity - far) / (near - far)
