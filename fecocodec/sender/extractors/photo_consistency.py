# mypy: allow-untyped-defs
"""Photo-consistency of the images at candidate depths: normalised cross-correlation of small windows.

Learned features at 1/4 resolution are distinctive; windows of pixels localise precisely. Together they halve the median
error of the matched depth (docs/what_we_learned.md).
"""

import numpy as np
import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Float, Float32, Int
from torch import Tensor

from fecocodec.geometry.cameras import Cameras, depth_from_relative_disparity
from fecocodec.grid import FEATURES
from fecocodec.kernels.compilation import compiled
from fecocodec.kernels.threads import run_in_ranges

RADIUS = 2  # windows are 5x5 pixels of the image at half size
LEAST_VARIANCE = np.float32(1e-3)  # added to window variances (sum over colours); prevents matches of noise
_COLOURS, _SUMS = 3, 5  # statistics of a window: three colours, their squares, their products with the reference
_SMALLEST_DEPTH = np.float32(1e-6)  # scenes are normalised to near = 1


@torch.no_grad()
def photo_consistency(
    images: Float[Tensor, "batch view 3 h w"],
    cameras: Cameras,
    sources: Int[Tensor, "batch view count"],
    num_candidates: int,
) -> Float[Tensor, "batch view candidate h4 w4"]:
    """Return the correlation, in [-1, 1], of windows of each view with those of its sources; mean over the sources.

    images: sRGB in [0, 1], sides multiples of 4. sources: indices of the source views of each view. Candidates are
    uniform in inverse depth from 1/far to 1/near. Windows are assumed to be fronto-parallel. A source that does not
    see the point contributes zero. The result has no gradient.
    """
    batch, views, _, height, width = images.shape
    if not sources.shape[-1]:
        return images.new_zeros(batch, views, num_candidates, height // FEATURES, width // FEATURES)
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
    """Return (turn, shift): turn @ (u, v, 1) * depth + shift is the homogeneous position in the source, in [0, 1]."""
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
    """Return 1 / length of the window around each pixel of a line. Windows are cropped at the border."""
    position = np.arange(side)
    length = np.minimum(position + RADIUS, side - 1) - np.maximum(position - RADIUS, 0) + 1
    return np.asarray(1.0 / length, np.float32)


@compiled
def _own_means(reference, weight, own):
    """Write the window means of the reference image to `own`, for `_normalise_row`."""
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
    """Write the normalised cross-correlation at candidates start to stop - 1 to `volume`."""
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
    """Warp one row: sample the source at the projections of the candidate's points. is_seen: 1 inside the source."""
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
    """Compute the sum of squares of a row's colours, and of their products with the reference."""
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
    """Write the window means of one row to `means`. values: padded with 0. columns: buffer for column sums."""
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
    """Write covariance / sqrt(product of variances) of one row to `scores`, from window means; 0 if not seen."""
    for column in range(len(scores)):
        own_variance = own[_COLOURS, column]
        variance, covariance = found[_COLOURS, column], found[_COLOURS + 1, column]
        for channel in range(_COLOURS):
            own_variance -= own[channel, column] * own[channel, column]
            variance -= found[channel, column] * found[channel, column]
            covariance -= own[channel, column] * found[channel, column]
        product = (max(own_variance, np.float32(0)) + LEAST_VARIANCE) * (max(variance, np.float32(0)) + LEAST_VARIANCE)
        scores[column] = covariance / np.sqrt(product) * is_seen[column]
