"""Comparison images: target, decoded view, error and depth side by side, one row per target view."""

import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.evaluation.extras import require_extra
from fecocodec.evaluation.systems.reconstruction import Reconstruction
from fecocodec.geometry.views import Views

ERROR_GAIN = 4.0  # an error of 1/4 has the last colour of the map
MAX_ROWS = 4


def strip(views: Views, num_context: int, found: Reconstruction) -> Float[Tensor, "3 height width"]:
    """Return the comparison image of the first MAX_ROWS target views, sRGB in [0, 1].

    Depth is drawn as disparity, from far (dark) to near (bright). Raises InputError if matplotlib is not installed.
    """
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
    """Map values in [0, 1] to viridis colours. Raises InputError if matplotlib is not installed."""
    colours = require_extra("matplotlib", "drawing strips").colormaps["viridis"](values.clamp(0, 1).numpy())
    return rearrange(torch.from_numpy(colours).float(), "h w rgba -> rgba h w")[:3]


def _relative_disparity(depth: Float[Tensor, "height width"], views: Views) -> Float[Tensor, "height width"]:
    """Return relative disparity: 0 at far and where nothing is rendered, 1 at near."""
    near, far = 1 / views.cameras.near, 1 / views.cameras.far
    disparity = torch.where(depth > 0, 1 / depth.clamp_min(1e-12), far)
    return (disparity - far) / (near - far)
