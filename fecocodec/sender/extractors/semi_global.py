# mypy: allow-untyped-defs
"""Semi-global aggregation of a cost volume: evidence flows along the rows, columns and diagonals of an image.

Hirschmueller, "Stereo processing by semiglobal matching and mutual information", 2008, section 2.3: along each of eight
directions a pixel may keep its neighbour's candidate for nothing, move by one for SMALL_STEP, or jump for LARGE_STEP.
"""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from fecocodec.rendering.compilation import compiled
from fecocodec.rendering.threads import run_in_ranges

SMALL_STEP, LARGE_STEP = 4.0, 24.0  # in units of the score
_DIRECTIONS = ((0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1))  # rows, columns
_FAR = np.float32(1e30)


@torch.no_grad()
def aggregated(score: Float[Tensor, "item candidate h w"]) -> Float[Tensor, "item candidate h w"]:
    """Mean of the eight directions' scores; higher is better, as in the volume that comes in. No gradient."""
    volume = np.ascontiguousarray(score.permute(0, 2, 3, 1).float().cpu().numpy())
    total = np.zeros_like(volume)
    run_in_ranges(_aggregate, len(volume), volume, total, np.float32(SMALL_STEP), np.float32(LARGE_STEP))
    return torch.from_numpy(total).permute(0, 3, 1, 2).to(score.device)


@compiled
def _aggregate(start, stop, score, total, small_step, large_step):
    """Add the mean over directions of items start to stop."""
    _, height, width, count = score.shape
    path = np.empty((height, width, count + 2), np.float32)  # costs, with a candidate out of reach at each end
    for item in range(start, stop):
        for direction in range(len(_DIRECTIONS)):
            down, right = _DIRECTIONS[direction]
            for step in range(height * width):
                row, column = step // width, step % width
                row = height - 1 - row if down < 0 else row
                column = width - 1 - column if right < 0 else column
                _follow(score, path, item, row, column, row - down, column - right, small_step, large_step)
                for candidate in range(count):
                    total[item, row, column, candidate] -= path[row, column, candidate + 1] / len(_DIRECTIONS)


@compiled
def _follow(score, path, item, row, column, from_row, from_column, small_step, large_step):
    """Cost of every candidate of a pixel, given those of the pixel before it on the path."""
    _, height, width, count = score.shape
    path[row, column, 0] = path[row, column, count + 1] = _FAR
    if from_row < 0 or from_row >= height or from_column < 0 or from_column >= width:
        for candidate in range(count):
            path[row, column, candidate + 1] = -score[item, row, column, candidate]
        return
    before, least = path[from_row, from_column], _FAR
    for candidate in range(count):
        least = min(least, before[candidate + 1])
    for candidate in range(count):
        step = min(before[candidate], before[candidate + 2]) + small_step
        best = min(min(before[candidate + 1], step), least + large_step)
        path[row, column, candidate + 1] = best - least - score[item, row, column, candidate]
