"""Coverage section of a stream: the cells of the coding grid that contain opaque pixels of the photographs."""

import numpy as np
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.container import COVERAGE_CELLS, Header

LEAST_OPACITY = 0.5  # pixels with at least this opacity count as opaque


def coverage_of(alpha: Float[Tensor, "view height width"] | None, header: Header) -> bytes | None:
    """Return `Stream.coverage`, or None if all cells are covered.

    alpha: opacity in [0, 1] at the size of the input views; None for opaque views.
    """
    if alpha is None:
        return None
    cells = covered_cells(alpha, COVERAGE_CELLS.shape(header))
    return None if bool(cells.all()) else cells_to_bits(cells)


def cells_to_bits(cells: Bool[Tensor, "view row column"]) -> bytes:
    """Pack cells, True if covered, into the bytes of `Stream.coverage`."""
    return np.packbits(cells.flatten().cpu().numpy()).tobytes()


def covered_cells(
    alpha: Float[Tensor, "view height width"], grid: tuple[int, int, int]
) -> Bool[Tensor, "view row column"]:
    """Return whether each cell overlaps a pixel with an opacity of at least LEAST_OPACITY.

    grid: (views, rows, columns) of the cells. They divide the image evenly, because the coding grid covers exactly the
    image.
    """
    return F.adaptive_max_pool2d(alpha[:, None].float(), grid[1:])[:, 0] >= LEAST_OPACITY
