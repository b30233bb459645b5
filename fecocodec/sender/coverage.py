"""Coverage section of a stream: the cells of the coding grid that the opaque parts of the photographs cover.

Photographs are composited on white, so cells across a silhouette decode with a white rim. They are left out, except
where a part is so thin that nothing of it would remain.
"""

from dataclasses import dataclass

import numpy as np
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.container import COVERAGE_CELLS, Header
from fecocodec.geometry.coding_grid import resample_to_grid
from fecocodec.sender.scene import Scene

LEAST_OPACITY = 0.5  # pixels with at least this opacity count as opaque
# Mean opacity of a covered cell. With a smaller value, rims show on black; with a larger one, missing borders show on
# white. At this value both errors are equal (docs/what_we_learned.md).
LEAST_MEAN_OPACITY = 0.8


def coverage_of(alpha: Float[Tensor, "view height width"] | None, header: Header) -> bytes | None:
    """Return `Stream.coverage`; None if all is covered. alpha: opacity of the input views in [0, 1]; None if opaque."""
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
    """Return whether each cell is covered.

    A cell is covered if its mean opacity is at least LEAST_MEAN_OPACITY. For thin parts, so is a cell with an opaque
    pixel, if no cell around it has that mean opacity.
    grid: (views, rows, columns) of the cells. They divide the image evenly, because the coding grid covers exactly the
    image.
    """
    opacity = alpha[:, None].float()
    is_within = F.adaptive_avg_pool2d(opacity, grid[1:]) >= LEAST_MEAN_OPACITY
    is_beside = F.max_pool2d(is_within.float(), 3, stride=1, padding=1) > 0
    has_opaque = F.adaptive_max_pool2d(opacity, grid[1:]) >= LEAST_OPACITY
    return (is_within | (has_opaque & ~is_beside))[:, 0]


WHITE, BLACK = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class CutOut:
    """transparency: 1 - opacity of the photographs, on the coding grid. is_covered: which Gaussians are emitted."""

    transparency: Float[Tensor, "view 1 h w"]
    is_covered: Bool[Tensor, "view n"]


def cut_out_of(scene: Scene, gaussians_per_side: int) -> CutOut | None:
    """Return the cut-out of a scene; None if all Gaussians are emitted. gaussians_per_side: of a cell."""
    if scene.alpha is None:
        return None
    rows, columns = (side // COVERAGE_CELLS.side for side in scene.images.shape[-2:])
    cells = covered_cells(scene.alpha, (scene.num_views, rows, columns))
    if bool(cells.all()):
        return None
    covered = cells.repeat_interleave(gaussians_per_side, dim=1).repeat_interleave(gaussians_per_side, dim=2)
    opacity = resample_to_grid(scene.alpha[:, None].float())
    return CutOut((1.0 - opacity).to(scene.images), covered.flatten(1).to(scene.images.device))
