"""Estimate near and far of a scene whose camera file does not state them.

A coarse plane sweep between pairs of views compares small grey images by normalised cross-correlation, at depths spaced
evenly in log depth from 0.05 to 500 baselines. Only depths that are consistent between both views of a pair are used.
"""

from dataclasses import dataclass, replace

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.geometry.cameras import Cameras, camera_to_world_points, pixel_rays, to_image
from fecocodec.geometry.depth_bounds import bounds_of_depths
from fecocodec.geometry.views import Views, joined

DEFAULT_RANGE = (1.0, 100.0)  # in scene units if there is no baseline, in baselines if nothing matches
LEAST_MATCHED = 0.05  # share of a view's pixels: depths of fewer say nothing about given bounds
# A given near may be so many times nearer than the estimate. On 12 training pairs, near and far 10 times too wide cost
# 2.5 dB at new views, with such a near 0.2 dB. Of 153 pairs and sets, one has an estimate above twice the given near.
MOST_BEFORE = 2.0
_MAX_COMPARED = 12  # views whose depth is estimated
# By baseline, of the cameras with which views are compared. With the closest pairs alone, far was wrong by more than a
# factor of 2.8 in 27% of 60 estimates on training captures, with these in 10%.
_RANKS = (0, 1, 2)
_LONG_SIDE = 96  # pixels of the small images
_WINDOW = 7  # pixels, side of the correlation window
_SWEEP = (0.05, 500.0)  # baselines
_NUM_DEPTHS = 128
_MIN_CORRELATION = 0.8
_MIN_LEAD = 0.05  # of the best correlation over the best one at a clearly different depth
_MIN_CONTRAST = 0.01  # standard deviation inside the window, of a range of 1
_NEIGHBOURHOOD = 5  # pixels, side of the square in which similar depths are counted
_MIN_LIKE_NEIGHBOURS = 9
_ESTIMATE_MARGIN = 1.3  # widens the estimate further, because surfaces visible in only one view are not matched


@dataclass(frozen=True)
class AgreedDepths:
    """Depths of the first view of a pair where both views are consistent, in scene units; share: of its pixels."""

    depths: Float[Tensor, " n"]
    share: float

    @property
    def bounds(self) -> tuple[float, float] | None:
        """(near, far) of these depths in scene units, None for too few."""
        return bounds_of_depths(self.depths.numpy())


def bounds_of_visible_points(points: Float[Tensor, "n 3"], cameras: Cameras) -> tuple[float, float]:
    """Return (near, far) of the points that the cameras see; DEFAULT_RANGE if they see too few.

    Uses at most 16 cameras and 2^16 points. near and far of the cameras are ignored.
    """
    chosen = torch.linspace(0, cameras.num_views - 1, min(cameras.num_views, 16)).round().long().tolist()
    seen = replace(cameras.select(chosen), near=torch.tensor(1e-6), far=torch.tensor(1.0))
    projected = seen.project(points[:: max(1, len(points) >> 16)])
    return bounds_of_depths(projected.depth[projected.is_visible].cpu().numpy()) or DEFAULT_RANGE


def estimate_depth_range(views: Views, guides: Views | None = None) -> tuple[float, float]:
    """Estimate (near, far) in scene units from images and poses; near and far of the cameras are ignored.

    guides: further photographs of the same size, with which views are compared; only depths of `views` count.
    Returns DEFAULT_RANGE in scene units if there is no baseline (one view, or all cameras at one position), and
    DEFAULT_RANGE times the shortest baseline if too few pixels match.
    """
    num_views = len(views.images)
    if guides is not None:
        views = joined([views, guides])
    grey, baselines = _small_grey(views.images), facing_baselines(views.cameras)
    for ranks in (_RANKS, (-1,)):  # the farthest camera where those beside a view are at its own position
        pairs = _pairs_of(baselines[:num_views], ranks)
        if not pairs:
            return DEFAULT_RANGE
        depths = torch.cat([_consistent_depths(grey[list(pair)], views.cameras.select(list(pair))) for pair in pairs])
        if bounds := bounds_of_depths(depths.numpy()):
            return bounds[0] / _ESTIMATE_MARGIN, bounds[1] * _ESTIMATE_MARGIN
    baseline = float(baselines.min())
    return DEFAULT_RANGE[0] * baseline, DEFAULT_RANGE[1] * baseline


def believable_bounds(views: Views, guides: Views | None = None) -> tuple[float, float] | None:
    """Return other (near, far), in scene units, if depths that need no bounds contradict those of the cameras.

    Both are estimates if these depths are beyond them, and near is if it is far before them. A far behind them stays:
    depth is coded by its inverse, so it costs little. guides: as for `estimate_depth_range`. None: no contradiction.
    """
    near, far = float(views.cameras.near), float(views.cameras.far)
    found = agreed_depths(views)
    if found.bounds is None or found.share < LEAST_MATCHED:
        return None
    is_beyond = near > found.bounds[1] or far < found.bounds[0]
    if not is_beyond and near * MOST_BEFORE * _ESTIMATE_MARGIN >= found.bounds[0]:
        return None
    estimate = estimate_depth_range(views, guides)
    if is_beyond:
        return estimate
    nearest = estimate[0] / MOST_BEFORE
    return (nearest, far) if near < 0.99 * nearest else None


def agreed_depths(views: Views) -> AgreedDepths:
    """Return the consistent depths of the closest pair of views; none if all cameras are at one position.

    Their share measures how well images and poses fit together. near and far of the cameras are ignored.
    """
    baselines = facing_baselines(views.cameras)
    if not bool(baselines.isfinite().any()):
        return AgreedDepths(torch.zeros(0), 0.0)
    pair = list(divmod(int(baselines.argmin()), len(baselines)))
    grey = _small_grey(views.images[pair])
    depths = _consistent_depths(grey, views.cameras.select(pair))
    return AgreedDepths(depths, len(depths) / grey[0].numel())


def facing_baselines(cameras: Cameras) -> Float[Tensor, "view view"]:
    """Return the distances of cameras that look the same way, within 60 degrees; infinite for others.

    It is infinite for cameras at one position, too. If no two look the same way, all others count.
    """
    centres, forward = cameras.extrinsics[:, :3, 3].double(), cameras.extrinsics[:, :3, 2]
    distances: Tensor = torch.linalg.vector_norm(centres[:, None] - centres, dim=-1)
    is_apart = distances > 1e-4 * distances.max()
    is_facing = is_apart & (forward @ forward.T > 0.5)
    return torch.where(is_facing if bool(is_facing.any()) else is_apart, distances, torch.inf)


def neighbour_pairs(cameras: Cameras, count: int, most: int) -> list[tuple[int, int]]:
    """Return the pairs of each of the first `count` views with the `most` nearest views that look the same way."""
    baselines = facing_baselines(cameras)
    pairs = {
        (min(view, other), max(view, other))
        for view in range(count)
        for other in baselines[view].argsort()[:most].tolist()
        if baselines[view, other].isfinite()
    }
    return sorted(pairs)


def _pairs_of(baselines: Float[Tensor, "view other"], ranks: tuple[int, ...]) -> list[tuple[int, int]]:
    """Return pairs of up to _MAX_COMPARED views with another camera each, the one of the next rank by its baseline.

    Views are in turn compared with cameras of different ranks, because the nearest one can be too near.
    """
    pairs, count = [], len(baselines)
    for number, view in enumerate(torch.linspace(0, count - 1, min(count, _MAX_COMPARED)).round().long().tolist()):
        others = baselines[view].argsort()[: int(baselines[view].isfinite().sum())].tolist()
        if others:
            rank = ranks[number % len(ranks)]
            pairs.append((view, others[min(rank, len(others) - 1)]))
    return pairs


def _small_grey(images: Float[Tensor, "view 3 height width"]) -> Float[Tensor, "view 1 small_height small_width"]:
    """Return the means over the colours, reduced to _LONG_SIDE pixels."""
    scale = min(1.0, _LONG_SIDE / max(images.shape[-2:]))
    grey = images.mean(dim=1, keepdim=True)
    size = [max(1, round(side * scale)) for side in images.shape[-2:]]
    return F.interpolate(grey, size, mode="bilinear", antialias=True, align_corners=False)


def _consistent_depths(grey: Float[Tensor, "2 1 height width"], cameras: Cameras) -> Float[Tensor, " n"]:
    """Return depths in the first of two views, at pixels where the depths of both views are consistent."""
    centres = cameras.extrinsics[:, :3, 3].double()
    baseline = torch.linalg.vector_norm(centres[1] - centres[0])
    extrinsics = cameras.extrinsics.clone()  # in baselines, so that the unit of length changes no rounding
    extrinsics[:, :3, 3] = (centres - centres[0]) / baseline
    cameras = replace(cameras, extrinsics=extrinsics)
    log_step = torch.log(torch.tensor(_SWEEP[1] / _SWEEP[0])).item() / (_NUM_DEPTHS - 1)
    there, seen_there = _sweep(grey, cameras)
    back, seen_back = _sweep(grey.flip(0), cameras.select([1, 0]))
    uv, depth_in_second = _project_into_second(there[None], cameras)
    grid = 2 * uv - 1
    found = F.grid_sample(back.log()[None, None], grid, mode="nearest", align_corners=False)[0, 0]
    found_is_good = F.grid_sample(seen_back.float()[None, None], grid, mode="nearest", align_corners=False)[0, 0] > 0.5
    agrees = (found - depth_in_second[0].clamp_min(1e-12).log()).abs() < 1.5 * log_step
    good = seen_there & found_is_good & agrees & (depth_in_second[0] > 0)
    return there[good & _has_like_neighbours(there.log(), good, log_step)] * baseline


def _has_like_neighbours(
    log_depths: Float[Tensor, "height width"], good: Bool[Tensor, "height width"], log_step: float
) -> Bool[Tensor, "height width"]:
    """Return which pixels have enough good neighbours at a similar depth; wrong matches are usually isolated."""
    around = F.unfold(log_depths[None, None], _NEIGHBOURHOOD, padding=_NEIGHBOURHOOD // 2)[0]
    good_around = F.unfold(good.to(around.dtype)[None, None], _NEIGHBOURHOOD, padding=_NEIGHBOURHOOD // 2)[0] > 0.5
    alike = good_around & ((around - log_depths.flatten()).abs() < 3 * log_step)
    return (alike.sum(dim=0) >= _MIN_LIKE_NEIGHBOURS).view_as(good)


def _sweep(
    grey: Float[Tensor, "2 1 height width"], cameras: Cameras
) -> tuple[Float[Tensor, "height width"], Bool[Tensor, "height width"]]:
    """Return the best depth of each pixel of the first view, and whether its match is good and unambiguous."""
    height, width = grey.shape[-2:]
    steps = torch.linspace(0, 1, _NUM_DEPTHS, dtype=torch.float64, device=grey.device)
    depths = (_SWEEP[0] * (_SWEEP[1] / _SWEEP[0]) ** steps).to(grey.dtype)
    uv, depth_in_second = _project_into_second(depths[:, None, None].expand(-1, height, width), cameras)
    warped = F.grid_sample(grey[1:].expand(_NUM_DEPTHS, -1, -1, -1), 2 * uv - 1, align_corners=False)
    correlation, contrast = _correlation(grey[:1], warped)
    visible = (depth_in_second > 0) & ((uv > 0) & (uv < 1)).all(dim=-1)
    correlation = correlation[:, 0].masked_fill(~visible, -1.0)
    best, index = correlation.max(dim=0)
    is_near_best = (torch.arange(_NUM_DEPTHS, device=grey.device)[:, None, None] - index).abs() <= 4
    runner_up = correlation.masked_fill(is_near_best, -1.0).amax(dim=0)
    is_clear = (best > _MIN_CORRELATION) & (best - runner_up > _MIN_LEAD) & (contrast[0, 0] > _MIN_CONTRAST)
    return depths[index], is_clear & (index > 0) & (index < _NUM_DEPTHS - 1)


def _project_into_second(
    depths: Float[Tensor, "depth height width"], cameras: Cameras
) -> tuple[Float[Tensor, "depth height width 2"], Float[Tensor, "depth height width"]]:
    """Project points at these depths of the first view into the second: normalised positions and depths there."""
    first, second = cameras.select([0]), cameras.select([1])
    rays = pixel_rays(first, *depths.shape[-2:])
    directions = camera_to_world_points(first, rays)[0] - first.extrinsics[0, :3, 3]
    offset = first.extrinsics[0, :3, 3] - second.extrinsics[0, :3, 3]
    points = (directions * depths[..., None] + offset) @ second.extrinsics[0, :3, :3]
    uv = to_image(points.flatten(0, 2), second.intrinsics[0], points[..., 2].flatten() > 0)
    return uv.view(*depths.shape, 2), points[..., 2]


def _correlation(
    first: Float[Tensor, "1 1 height width"], second: Float[Tensor, "depth 1 height width"]
) -> tuple[Float[Tensor, "depth 1 height width"], Float[Tensor, "1 1 height width"]]:
    """Return the normalised cross-correlation over windows, and the standard deviation of `first` in each window."""
    mean_first, mean_second = _window_mean(first), _window_mean(second)
    variance_first = (_window_mean(first**2) - mean_first**2).clamp_min(0)
    variance_second = (_window_mean(second**2) - mean_second**2).clamp_min(0)
    covariance = _window_mean(first * second) - mean_first * mean_second
    return covariance / (variance_first * variance_second + 1e-10).sqrt(), variance_first.sqrt()


def _window_mean(image: Float[Tensor, "batch 1 height width"]) -> Float[Tensor, "batch 1 height width"]:
    """Return the mean over the part of each window inside the image, as a separable filter."""
    half = _WINDOW // 2
    rows = F.avg_pool2d(image, (1, _WINDOW), stride=1, padding=(0, half), count_include_pad=False)
    return F.avg_pool2d(rows, (_WINDOW, 1), stride=1, padding=(half, 0), count_include_pad=False)
