"""Conversion of the coverage section to a bitmap of cells and to a mask of Gaussians."""

import numpy as np
import torch
from einops import rearrange, repeat
from jaxtyping import Bool
from torch import Tensor

from fecocodec.container.coverage import coverage_grid
from fecocodec.container.header import Header


def cells_to_bits(cells: Bool[Tensor, "view row column"]) -> bytes:
    """Pack cells (True if covered), of the shape that `coverage_grid` returns, into the bytes of `Stream.coverage`."""
    return np.packbits(cells.flatten().cpu().numpy()).tobytes()


def bits_to_cells(bits: bytes, header: Header) -> Bool[Tensor, "view row column"]:
    """Invert `cells_to_bits`."""
    return torch.from_numpy(np.unpackbits(np.frombuffer(bits, dtype=np.uint8))).bool().view(coverage_grid(header))


def is_in_covered_cell(bits: bytes, header: Header, gaussians_per_side: int = 2) -> Bool[Tensor, " n"]:
    """Return which Gaussians belong to a covered cell, ordered (view, row, column).

    gaussians_per_side: of a cell, 4x4 pixels; 2 for one Gaussian per 2x2 pixels.
    """
    side = gaussians_per_side
    return rearrange(
        repeat(bits_to_cells(bits, header), "v r c -> v r i c j", i=side, j=side), "v r i c j -> (v r i c j)"
    )
