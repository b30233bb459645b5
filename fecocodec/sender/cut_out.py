"""Photographs with transparent parts: what a decoder emits of their Gaussians, and the backgrounds they are judged on.

The networks see such photographs on white. Optimisation compares pictures on white and on black: judged on white alone,
a white Gaussian at a silhouette is as good as none, and shows as a rim on every other background.
"""

from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from fecocodec.container import COVERAGE_CELLS
from fecocodec.geometry.coding_grid import resample_to_grid
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.rendering.rasterizer import Rendering
from fecocodec.sender.coverage import covered_cells
from fecocodec.sender.scene import Scene

WHITE, BLACK = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)
Pictures = Float[Tensor, "picture 3 h w"]


@dataclass(frozen=True)
class CutOut:
    """transparency: 1 - opacity of the photographs, on the coding grid. is_covered: which Gaussians are emitted."""

    transparency: Float[Tensor, "view 1 h w"]
    is_covered: Bool[Tensor, "view n"]

    def emitted(self, gaussians: Gaussians) -> Gaussians:
        """Return the Gaussians, ordered (view, row, column), with an opacity of 0 where none is emitted."""
        return replace(gaussians, opacities=gaussians.opacities * self.is_covered.flatten())

    def photographs(self, images: Float[Tensor, "view 3 h w"]) -> Pictures:
        """Return the photographs on white, then on black. images: on white."""
        return torch.cat((images, images - self.transparency))

    def pictures(self, rendering: Rendering) -> Pictures:
        """Return the renderings on white, then on black. rendering: on black."""
        return torch.cat((rendering.color + (1.0 - rendering.alpha[:, None]), rendering.color))


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
