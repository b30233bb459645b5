# mypy: allow-untyped-defs
"""Semi-global aggregation of a cost volume along the rows, columns and diagonals of the image.

Hirschmueller, "Stereo processing by semiglobal matching and mutual information", 2008, section 2.3. Along each of eight
directions, a change of the candidate between neighbouring pixels costs SMALL_STEP for one candidate and LARGE_STEP for
more. Both penalties are reduced at colour edges, where depth discontinuities are likely.
"""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.kernels.compilation import compiled
from fecocodec.kernels.threads import run_in_ranges

SMALL_STEP, LARGE_STEP = 6.0, 36.0  # penalties between pixels of equal colour, in units of the score
ACROSS_EDGE = 0.27  # factor of the penalties between pixels of very different colours
EDGE = 0.08  # colour distance, sRGB in [0, 1], over which the factor decays from 1 towards ACROSS_EDGE
_DIRECTIONS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1))  # rows, columns
_FAR = np.float32(1e30)


@torch.no_grad()
def aggregate_costs(
    score: Float[Tensor, "item candidate h w"], colours: Float[Tensor, "item 3 h w"]
) -> Float[Tensor, "item candidate h w"]:
    """Return the mean of the aggregated scores of eight directions. The result has no gradient.

    score: matching scores, higher is better, as in the result. colours: of the pixels, sRGB in [0, 1].
    """
    volume = np.ascontiguousarray(score.permute(0, 2, 3, 1).float().cpu().numpy())
    picture = np.ascontiguousarray(colours.permute(0, 2, 3, 1).float().cpu().numpy())
    total = np.zeros_like(volume)
    rules = np.array([SMALL_STEP, LARGE_STEP, ACROSS_EDGE, EDGE], np.float32)
    run_in_ranges(_aggregate, len(volume), volume, picture, total, rules)
    return torch.from_numpy(total).permute(0, 3, 1, 2).to(score.device)


@compiled
def _aggregate(start, stop, score, picture, total, rules):
    """Add the mean over directions of items start to stop - 1 to `total`."""
    _, height, width, count = score.shape
    path = np.empty((height, width, count + 2), np.float32)  # costs, padded with an unreachable candidate at each end
    for item in range(start, stop):
        for direction in range(len(_DIRECTIONS)):
            down, right = _DIRECTIONS[direction]
            for step in range(height * width):
                row, column = step // width, step % width
                row = height - 1 - row if down < 0 else row
                column = width - 1 - column if right < 0 else column
                _follow(score, picture, path, item, row, column, row - down, column - right, rules)
                for candidate in range(count):
                    total[item, row, column, candidate] -= path[row, column, candidate + 1] / len(_DIRECTIONS)


@compiled
def _follow(score, picture, path, item, row, column, from_row, from_column, rules):
    """Compute the path cost of every candidate of a pixel from those of the previous pixel on the path."""
    _, height, width, count = score.shape
    path[row, column, 0] = path[row, column, count + 1] = _FAR
    if from_row < 0 or from_row >= height or from_column < 0 or from_column >= width:
        for candidate in range(count):
            path[row, column, candidate + 1] = -score[item, row, column, candidate]
        return
    share = _share_of_step(picture[item, row, column], picture[item, from_row, from_column], rules)
    small_step, large_step = share * rules[0], share * rules[1]
    before, least = path[from_row, from_column], _FAR
    for candidate in range(count):
        least = min(least, before[candidate + 1])
    for candidate in range(count):
        step = min(before[candidate], before[candidate + 2]) + small_step
        best = min(min(before[candidate + 1], step), least + large_step)
        path[row, column, candidate + 1] = best - least - score[item, row, column, candidate]


@compiled
def _share_of_step(colour, neighbour, rules):
    """Return the factor of the penalties between two pixels: 1 for equal colours, down to ACROSS_EDGE."""
    squared = np.float32(0)
    for channel in range(len(colour)):
        squared += (colour[channel] - neighbour[channel]) ** 2
    return rules[2] + (np.float32(1) - rules[2]) * np.exp(-np.sqrt(squared) / rules[3])
