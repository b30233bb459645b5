"""Side-by-side pictures: target, decoded, error, depth; one row a target view."""

import torch
from einops import rearrange
from jaxtyping import Float
from torch import Tensor

from fecocodec.evaluation.extras import require_extra
from fecocodec.evaluation.systems.reconstruction import Reconstruction
from fecocodec.geometry.views import Views

ERROR_GAIN = 4.0  # a difference of a quarter of the range is drawn in the last colour
MAX_ROWS = 4


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
    """Values in [0, 1] as viridis colours. Raises InputError where matplotlib is not installed."""
    colours = require_extra("matplotlib", "drawing strips").colormaps["viridis"](values.clamp(0, 1).numpy())
    return rearrange(torch.from_numpy(colours).float(), "h w rgba -> rgba h w")[:3]


def _relative_disparity(depth: Float[Tensor, "height width"], views: Views) -> Float[Tensor, "height width"]:
    """0 at far and where nothing was rendered, 1 at near."""
    near, far = 1 / views.cameras.near, 1 / views.cameras.far
    disparity = torch.where(depth > 0, 1 / depth.clamp_min(1e-12), far)
    return (disparity - far) / (near - far)
