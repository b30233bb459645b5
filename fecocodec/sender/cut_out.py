"""Photographs with transparent parts: which of their Gaussians a decoder emits. The networks see them on white."""

from dataclasses import dataclass

from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.container import COVERAGE_CELLS
from fecocodec.geometry.coding_grid import resample_to_grid
from fecocodec.sender.coverage import covered_cells
from fecocodec.sender.scene import Scene

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
