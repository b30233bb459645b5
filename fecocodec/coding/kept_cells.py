"""The cells of a keep section as a bitmap, and as the Gaussians that a receiver emits."""

import numpy as np
import torch
from jaxtyping import Bool
from torch import Tensor

from fecocodec.container.header import Header
from fecocodec.container.keep import CELL, Keep, cell_grid
from fecocodec.geometry.padding import padded_size

_GAUSSIANS_A_CELL = CELL // 2  # along each side: one Gaussian stands for 2x2 pixels


def cells_to_bits(cells: Bool[Tensor, "view row column"]) -> bytes:
    """`Keep.cells` for these cells (True: emit their Gaussians), see `cell_grid` for their number."""
    return np.packbits(cells.flatten().cpu().numpy()).tobytes()


def bits_to_cells(bits: bytes, header: Header) -> Bool[Tensor, "view row column"]:
    """The inverse of `cells_to_bits`."""
    grid = cell_grid(header)
    flat = np.unpackbits(np.frombuffer(bits, dtype=np.uint8), count=grid[0] * grid[1] * grid[2])
    return torch.from_numpy(flat).bool().view(grid)


def is_in_kept_cell(keep: Keep, header: Header) -> Bool[Tensor, " n"]:
    """Which Gaussians of the padded views' 1/2 grids, ordered (view, row, column), lie in a cell that is kept."""
    views, rows, columns = cell_grid(header)
    height, width = padded_size(header.height, header.width)
    kept = torch.ones(views, height // 2, width // 2, dtype=torch.bool)
    if keep.cells is not None:
        cells = bits_to_cells(keep.cells, header)
        spread = cells.repeat_interleave(_GAUSSIANS_A_CELL, dim=1).repeat_interleave(_GAUSSIANS_A_CELL, dim=2)
        kept[:, : _GAUSSIANS_A_CELL * rows, : _GAUSSIANS_A_CELL * columns] = spread
    return kept.flatten()
