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
from fecocodec.kernels.compilation import compiled
from fecocodec.kernels.threads import run_in_ranges

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
    pictures = rearrange(half, "(b v) c h w -> b v c h w", b=batch).float().cpu().contiguous().numpy()
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
    reference: Float32[np.ndarray, "3 h w"],
    source: Float32[np.ndarray, "3 h w"],
    turn: Float32[np.ndarray, "3 3"],
    shift: Float32[np.ndarray, " 3"],
    depths: Float32[np.ndarray, " candidate"],
) -> Float32[np.ndarray, "candidate h w"]:
    volume = np.empty((len(depths), *reference.shape[1:]), np.float32)
    weight = _share_of_window(reference.shape[1])[:, None] * _share_of_window(reference.shape[2])
    own = np.empty((_SUMS, *weight.shape), np.float32)
    _own_means(reference, weight, own)
    arguments = (reference, own, weight, source, turn, shift, depths, volume)
    run_in_ranges(_correlate, len(depths), *arguments)
    return volume


def _share_of_window(side: int) -> Float32[np.ndarray, " side"]:
    """One over the length of the window around each pixel of a line; windows end at the border."""
    place = np.arange(side)
    length = np.minimum(place + RADIUS, side - 1) - np.maximum(place - RADIUS, 0) + 1
    return np.asarray(1.0 / length, np.float32)


@compiled
def _own_means(reference, weight, own):
    """What `_normalise_row` needs of the reference's windows."""
    _, height, width = reference.shape
    values = np.zeros((_SUMS, height + 2 * RADIUS, width + 2 * RADIUS), np.float32)
    for row in range(height):
        for channel in range(_COLOURS):
            for column in range(width):
                values[channel, row + RADIUS, column + RADIUS] = reference[channel, row, column]
        _complete_row(values, reference, row)
    columns = np.empty((_SUMS, width + 2 * RADIUS), np.float32)
    for row in range(height):
        _window_means(values, row, weight[row], columns, own[:, row])


@compiled
def _correlate(start, stop, reference, own, weight, source, turn, shift, depths, volume):
    """Normalised cross-correlation at candidates start to stop."""
    _, height, width = reference.shape
    values = np.zeros((_SUMS, height + 2 * RADIUS, width + 2 * RADIUS), np.float32)
    is_seen = np.empty((height, width), np.float32)
    corner, fractions = np.empty(width, np.int32), np.empty((2, width), np.float32)
    columns, found = np.empty((_SUMS, width + 2 * RADIUS), np.float32), np.empty((_SUMS, width), np.float32)
    for candidate in range(start, stop):
        for row in range(height):
            _sample_row(source, turn, shift, depths[candidate], row, corner, fractions, values, is_seen[row])
            _complete_row(values, reference, row)
        for row in range(height):
            _window_means(values, row, weight[row], columns, found)
            _normalise_row(own[:, row], found, is_seen[row], volume[candidate, row])


@compiled
def _sample_row(source, turn, shift, depth, row, corner, fractions, values, is_seen):
    """Set a row's colours to the source's where the candidate's points fall, and whether that is inside."""
    _, height, width = source.shape
    v = np.float32((row + 0.5) / height)
    for column in range(width):
        u = np.float32((column + 0.5) / width)
        x = (turn[0, 0] * u + turn[0, 1] * v + turn[0, 2]) * depth + shift[0]
        y = (turn[1, 0] * u + turn[1, 1] * v + turn[1, 2]) * depth + shift[1]
        z = (turn[2, 0] * u + turn[2, 1] * v + turn[2, 2]) * depth + shift[2]
        is_in_front = z >= _SMALLEST_DEPTH
        share = np.float32(1) / max(z, _SMALLEST_DEPTH)
        x, y = x * share * width - np.float32(0.5), y * share * height - np.float32(0.5)
        is_inside = x >= -0.5 and x <= width - 0.5 and y >= -0.5 and y <= height - 0.5
        x, y = min(max(x, np.float32(0)), np.float32(width - 1)), min(max(y, np.float32(0)), np.float32(height - 1))
        left, top = min(np.int32(x), np.int32(width - 2)), min(np.int32(y), np.int32(height - 2))
        corner[column], fractions[0, column], fractions[1, column] = top * width + left, x - left, y - top
        is_seen[column] = np.float32(1) if is_in_front and is_inside else np.float32(0)
    for channel in range(_COLOURS):
        plane = source[channel].reshape(-1)
        for column in range(width):
            first, right, down = np.uintp(corner[column]), fractions[0, column], fractions[1, column]
            second = first + np.uintp(width)
            above = plane[first] * (1 - right) + plane[first + np.uintp(1)] * right
            below = plane[second] * (1 - right) + plane[second + np.uintp(1)] * right
            values[channel, row + RADIUS, column + RADIUS] = above * (1 - down) + below * down


@compiled
def _complete_row(values, reference, row):
    """The squares of a row's colours, summed, and its products with the reference's, from the colours."""
    for column in range(reference.shape[2]):
        squares = products = np.float32(0)
        for channel in range(_COLOURS):
            colour = values[channel, row + RADIUS, column + RADIUS]
            squares += colour * colour
            products += colour * reference[channel, row, column]
        values[_COLOURS, row + RADIUS, column + RADIUS] = squares
        values[_COLOURS + 1, row + RADIUS, column + RADIUS] = products


@compiled
def _window_means(values, row, weight, columns, means):
    """Means over the windows of one row; values are 0 around the border. columns: room for sums along them."""
    for k in range(_SUMS):
        for column in range(columns.shape[1]):
            columns[k, column] = values[k, row, column]
        for near in range(1, 2 * RADIUS + 1):
            for column in range(columns.shape[1]):
                columns[k, column] += values[k, row + near, column]
        for column in range(means.shape[1]):
            total = columns[k, column]
            for near in range(1, 2 * RADIUS + 1):
                total += columns[k, column + near]
            means[k, column] = total * weight[column]


@compiled
def _normalise_row(own, found, is_seen, scores):
    """Covariance over the root of both variances, from means of colours, squares and products; 0 where not seen."""
    for column in range(len(scores)):
        own_variance = own[_COLOURS, column]
        variance, covariance = found[_COLOURS, column], found[_COLOURS + 1, column]
        for channel in range(_COLOURS):
            own_variance -= own[channel, column] * own[channel, column]
            variance -= found[channel, column] * found[channel, column]
            covariance -= own[channel, column] * found[channel, column]
        product = (max(own_variance, np.float32(0)) + LEAST_VARIANCE) * (max(variance, np.float32(0)) + LEAST_VARIANCE)
        scores[column] = covariance / np.sqrt(product) * is_seen[column]
