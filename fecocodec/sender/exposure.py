"""Give photographs the exposure and white balance of those beside them, by the colours of points that look alike.

Between two photographs, the colours of such points differ by a factor for each channel. The factors of all pairs give
exposures, by least squares of their logarithms. Each photograph gets the mean of its own and its neighbours'. What
changes slowly along a walk stays: it does no harm to new views, and photographs between look like it.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import reduce

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.depth_range import neighbour_pairs
from fecocodec.geometry.sparse_matches import Corners, alike, small
from fecocodec.geometry.views import Views

_NEIGHBOURS = 3  # with which a photograph is compared
_WINDOW = 9  # side of the square around a point whose mean colour is compared, in pixels of the small image
_LEAST_POINTS, _LEAST_AGREEMENT = 20, 0.5  # of points that look alike, and of the share whose factors agree
_LARGEST_SPREAD = 0.1  # of logarithms of factors that agree
_DARKEST, _BRIGHTEST = 0.06, 0.94  # mean colours that are compared: beyond them sensors clip
LEAST_DIFFERENCE = 0.05  # of the logarithm of a factor; smaller ones are shading and wrong matches


def exposure_factors(parts: Sequence[Views], corners: Sequence[Corners]) -> tuple[Float[Tensor, "view 3"], ...] | None:
    """Return what the colours of each view have to be multiplied with, per channel, by part; None if all hardly differ.

    parts: views of one scene. corners: of all of them.
    """
    cameras = reduce(Cameras.joined, (part.cameras for part in parts))
    images = (image for part in parts for image in part.images)
    found = [_colours_of(image, of_image) for image, of_image in zip(images, corners, strict=True)]
    pairs = neighbour_pairs(cameras, len(found), _NEIGHBOURS)
    ratios = [((i, j), _log_ratio(corners[i], corners[j], (found[i], found[j]))) for i, j in pairs]
    equations = [(pair, ratio) for pair, ratio in ratios if ratio is not None]
    if not equations:
        return None
    differences = torch.zeros(len(equations), len(found))
    for row, ((first, second), _) in zip(differences, equations, strict=True):
        row[first], row[second] = 1.0, -1.0
    exposures = torch.linalg.pinv(differences) @ torch.stack([ratio for _, ratio in equations])  # logarithms
    is_beside = differences.abs().T @ differences.abs() > 0  # a photograph is beside itself
    share = is_beside.float() / is_beside.sum(dim=1, keepdim=True).clamp_min(1)
    logs = share @ exposures - exposures
    if float(logs.abs().max()) <= LEAST_DIFFERENCE:
        return None
    return torch.exp(logs).split([len(part.images) for part in parts])


def with_factors(views: Views, factors: Float[Tensor, "view 3"]) -> Views:
    """Return the views with these factors of their colours. The white of transparent parts stays."""
    white = torch.zeros(()) if views.alpha is None else 1.0 - views.alpha[:, None]
    return replace(views, images=(white + (views.images - white) * factors[..., None, None]).clamp(0, 1))


def _colours_of(image: Float[Tensor, "3 height width"], corners: Corners) -> Float[Tensor, "corner 3"]:
    """Return the mean colours around the corners of a photograph."""
    means = F.avg_pool2d(small(image), _WINDOW, stride=1, padding=_WINDOW // 2, count_include_pad=False)
    of_corners = F.grid_sample(means, 2 * corners.positions[None, :, None] - 1, align_corners=False)
    return of_corners[0, ..., 0].T


def _log_ratio(
    first: Corners, second: Corners, colours: tuple[Float[Tensor, "corner 3"], Float[Tensor, "other 3"]]
) -> Float[Tensor, "3"] | None:
    """Return the median logarithm of first over second at points that look alike; None if few agree on it.

    colours: at the corners of both.
    """
    pairs = torch.stack([of_corners[chosen] for of_corners, chosen in zip(colours, alike(first, second), strict=True)])
    pairs = pairs[:, ((pairs > _DARKEST) & (pairs < _BRIGHTEST)).all(dim=2).all(dim=0)]
    if pairs.shape[1] < _LEAST_POINTS:
        return None
    logs = torch.log(pairs[0] / pairs[1])
    median = logs.median(dim=0).values
    agreement = ((logs - median).abs().mean(dim=1) < _LARGEST_SPREAD).float().mean()
    return median if float(agreement) >= _LEAST_AGREEMENT else None
