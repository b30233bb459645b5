# mypy: allow-untyped-defs
"""How well the photographs themselves agree at candidate depths: normalised cross-correlation of small windows.

Learned features at 1/4 resolution tell places apart; windows of pixels tell exactly where. Together they halve the
median error of the matched depth (docs/experiments.md).
"""

import numpy as np
import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float, Float32, Int
from torch import Tensor

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.depth import depth_from_relative_disparity
from fecocodec.rendering.compilation import compiled
from fecocodec.rendering.threads import run_in_ranges

RADIUS = 2  # of the window: 5x5 pixels of the image at half size
LEAST_VARIANCE = np.float32(1e-3)  # of a window, all colours together; keeps noise of flat regions from matching
_COLOURS, _SUMS = 3, 5  # of a window: three colours, the sum of their squares, of their products with the reference
_SMALLEST_DEPTH = np.float32(1e-6)  # scenes are normalised to near = 1


@torch.no_grad()
def photo_consistency(
    images: Float[Tensor, "batch view 3 h w"],
    cameras: Cameras,
    sources: Int[Tensor, "batch view count"],
    num_candidates: int,
) -> Float[Tensor, "batch view candidate h4 w4"]:
    """Correlation in [-1, 1] of a view's windows with those of its sources, mean over sources, no gradient.

    Candidates are uniform in inverse depth from 1/far to 1/near, and a window is taken to have one depth and to look
    towards the camera. Zero where a source does not see the point.
    """
    batch, views, _, height, width = images.shape
    if not sources.shape[-1]:
        return images.new_zeros(batch, views, num_candidates, height // 4, width // 4)
    half = F.avg_pool2d(rearrange(images, "b v c h w -> (b v) c h w"), 2)
    pictures = rearrange(half, "(b v) c h w -> b v h w c", b=batch).float().cpu().contiguous().numpy()
    relative = torch.linspace(0.0, 1.0, num_candidates, device=images.device)
    depth = depth_from_relative_disparity(relative[None, None, :, None].expand(batch, 1, -1, 1), cameras)
    depths = depth[:, 0, :, 0].float().cpu().numpy()
    volumes = []
    for scene, (own, candidates) in enumerate(zip(pictures, depths, strict=True)):
        for view, others in enumerate(sources[scene].tolist()):
            mappings = [_mapping(cameras.scene(scene), view, other) for other in others]
            pairs = zip(others, mappings, strict=True)
            found = [_correlations(own[view], own[other], *mapping, candidates) for other, mapping in pairs]
            volumes.append(np.mean(found, axis=0))
    volume = F.avg_pool2d(torch.from_numpy(np.stack(volumes)), 2)
    return rearrange(volume, "(b v) d h w -> b v d h w", b=batch).to(images.device)


def _mapping(cameras: Cameras, view: int, source: int) -> tuple[Float32[np.ndarray, "3 3"], Float32[np.ndarray, " 3"]]:
    """(turn, shift): turn @ (u, v, 1) * depth + shift is the source's homogeneous image position, u and v in [0, 1]."""
    to_source = cameras.world_to_camera[source].double() @ cameras.extrinsics[view].double()
    intrinsics = cameras.intrinsics.double()
    turn = intrinsics[source] @ to_source[:3, :3] @ torch.linalg.inv(intrinsics[view])
    shift = intrinsics[source] @ to_source[:3, 3]
    return turn.float().cpu().numpy(), shift.float().cpu().numpy()


def _correlations(
    reference: Float32[np.ndarray, "h w 3"],
    source: Float32[np.ndarray, "h w 3"],
    turn: Float32[np.ndarray, "3 3"],
    shift: Float32[np.ndarray, " 3"],
    depths: Float32[np.ndarray, " candidate"],
) -> Float32[np.ndarray, "candidate h w"]:
    volume = np.empty((len(depths), *reference.shape[:2]), np.float32)
    run_in_ranges(_correlate, len(depths), reference, _own_means(reference), source, turn, shift, depths, volume)
    return volume


@compiled
def _own_means(reference):
    """What `_normalised` needs of the reference's windows."""
    height, width, _ = reference.shape
    values = np.empty((height, width, _SUMS), np.float32)
    for row in range(height):
        for column in range(width):
            for channel in range(_COLOURS):
                values[row, column, channel] = reference[row, column, channel]
            _complete(values[row, column], reference[row, column])
    return _window_means(values)


@compiled
def _correlate(start, stop, reference, own, source, turn, shift, depths, volume):
    """Normalised cross-correlation at candidates start to stop."""
    height, width, _ = reference.shape
    values = np.empty((height, width, _SUMS), np.float32)
    is_seen = np.empty((height, width), np.bool_)
    for candidate in range(start, stop):
        for row in range(height):
            for column in range(width):
                is_seen[row, column] = _sample(source, turn, shift, depths[candidate], row, column, values[row, column])
                _complete(values[row, column], reference[row, column])
        found = _window_means(values)
        for row in range(height):
            for column in range(width):
                score = _normalised(own[row, column], found[row, column]) if is_seen[row, column] else np.float32(0)
                volume[candidate, row, column] = score


@compiled
def _sample(source, turn, shift, depth, row, column, colour):
    """Set the colour that the source has where the candidate's point falls; returns whether that is inside."""
    height, width, _ = source.shape
    u, v = np.float32((column + 0.5) / width), np.float32((row + 0.5) / height)
    x = (turn[0, 0] * u + turn[0, 1] * v + turn[0, 2]) * depth + shift[0]
    y = (turn[1, 0] * u + turn[1, 1] * v + turn[1, 2]) * depth + shift[1]
    z = (turn[2, 0] * u + turn[2, 1] * v + turn[2, 2]) * depth + shift[2]
    if z < _SMALLEST_DEPTH:
        for channel in range(_COLOURS):
            colour[channel] = np.float32(0)
        return False
    x, y = x / z * width - np.float32(0.5), y / z * height - np.float32(0.5)
    is_inside = x >= -0.5 and x <= width - 0.5 and y >= -0.5 and y <= height - 0.5
    x, y = min(max(x, np.float32(0)), np.float32(width - 1)), min(max(y, np.float32(0)), np.float32(height - 1))
    left, top = min(int(x), width - 2), min(int(y), height - 2)
    right, down = np.float32(x - left), np.float32(y - top)
    for channel in range(_COLOURS):
        above = source[top, left, channel] * (1 - right) + source[top, left + 1, channel] * right
        below = source[top + 1, left, channel] * (1 - right) + source[top + 1, left + 1, channel] * right
        colour[channel] = above * (1 - down) + below * down
    return is_inside


@compiled
def _complete(values, colour):
    """The squares of a colour, summed, and its products with another, from the colour that `values` begins with."""
    squares = products = np.float32(0)
    for channel in range(_COLOURS):
        squares += values[channel] * values[channel]
        products += values[channel] * colour[channel]
    values[_COLOURS], values[_COLOURS + 1] = squares, products


@compiled
def _normalised(own, found):
    """Covariance over the root of both variances, from means of colours, squares and products."""
    own_variance, variance, covariance = own[_COLOURS], found[_COLOURS], found[_COLOURS + 1]
    for channel in range(_COLOURS):
        own_variance -= own[channel] * own[channel]
        variance -= found[channel] * found[channel]
        covariance -= own[channel] * found[channel]
    return covariance / np.sqrt((max(own_variance, 0) + LEAST_VARIANCE) * (max(variance, 0) + LEAST_VARIANCE))


@compiled
def _window_means(values):
    """Means over windows, which end at the border; rows first, then columns."""
    height, width, count = values.shape
    along, means = np.zeros_like(values), np.zeros_like(values)
    for row in range(height):
        for column in range(width):
            first, last = max(column - RADIUS, 0), min(column + RADIUS, width - 1)
            for near in range(first, last + 1):
                for k in range(count):
                    along[row, column, k] += values[row, near, k]
            for k in range(count):
                along[row, column, k] /= np.float32(last - first + 1)
    for row in range(height):
        first, last = max(row - RADIUS, 0), min(row + RADIUS, height - 1)
        for near in range(first, last + 1):
            for column in range(width):
                for k in range(count):
                    means[row, column, k] += along[near, column, k]
        for column in range(width):
            for k in range(count):
                means[row, column, k] /= np.float32(last - first + 1)
    return means
