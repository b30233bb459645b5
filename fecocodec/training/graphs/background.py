"""The background layer as graphs. Of each part: its candidates, and a step over views that finds the hidden ones."""

from collections.abc import Callable

import torch
from torch import Tensor, nn

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import SH_DEGREE_0, Gaussians
from fecocodec.splatting.background import DEFAULT_BACKGROUND, background_candidates, cell_centres
from fecocodec.splatting.hidden import ExtendedDepth, is_hidden_from, standard_deviations
from fecocodec.splatting.occluded import is_behind

Find = Callable[[Gaussians, Cameras, tuple[int, int]], tuple[Gaussians, Tensor]]
"""(emitted Gaussians, cameras, grid) -> candidates of one part, and the depth that decides which are hidden."""


class CandidatesGraph(nn.Module):
    """Maps of the emitted Gaussians, cameras -> candidates of a part, and the depth that decides which are hidden.

    opacities: 0 for Gaussians that are not emitted.
    """

    def __init__(self, find: Find) -> None:
        super().__init__()
        self.find = find

    def forward(
        self, positions: Tensor, opacities: Tensor, colours: Tensor, extrinsics: Tensor, intrinsics: Tensor
    ) -> tuple[Tensor, ...]:
        means = positions.permute(0, 2, 3, 1).flatten(0, 2)
        harmonics = (colours.permute(0, 2, 3, 1).flatten(0, 2)[:, None] - 0.5) / SH_DEGREE_0
        shapes = torch.zeros_like(means), torch.zeros_like(means)[:, [0, 0, 0, 0]]  # not used
        gaussians = Gaussians(means, *shapes, opacities.flatten(), harmonics)
        grid = (opacities.shape[1], opacities.shape[2])
        found, depth = self.find(gaussians, _cameras(extrinsics, intrinsics), grid)
        return *found.fields(), depth


def outside_candidates(gaussians: Gaussians, cameras: Cameras, grid: tuple[int, int]) -> tuple[Gaussians, Tensor]:
    """Return the candidates outside all images, and the extended depth of views."""
    found, extended = background_candidates(gaussians, cameras, grid)
    return found, extended.depth


class HideGraph(nn.Module):
    """A view, candidates of the background layer -> candidates that this view does not show, among the hidden ones."""

    centres: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("centres", cell_centres(DEFAULT_BACKGROUND, torch.zeros(1)))

    def forward(
        self,
        view: Tensor,
        means: Tensor,
        scales: Tensor,
        rotations: Tensor,
        extended: Tensor,
        extrinsics: Tensor,
        intrinsics: Tensor,
        hidden: Tensor,
    ) -> Tensor:
        index = view[None].long()
        cameras = _cameras(extrinsics, intrinsics)
        of_view = (x.index_select(0, index)[0] for x in (extended, cameras.world_to_camera, intrinsics))
        candidates = Gaussians(means, scales, rotations, means[:, 0], means[:, None])  # opacity, colour are not used
        bounds = ExtendedDepth(extended, self.centres).bounds
        return hidden & is_hidden_from(means.T, standard_deviations(candidates), bounds, *of_view)


class BehindGraph(nn.Module):
    """A view, candidates of the occluded part -> candidates that this view does not show, among the hidden ones."""

    def forward(
        self, view: Tensor, means: Tensor, surface: Tensor, extrinsics: Tensor, intrinsics: Tensor, hidden: Tensor
    ) -> Tensor:
        index = view[None].long()
        cameras = _cameras(extrinsics, intrinsics)
        of_view = (x.index_select(0, index)[0] for x in (surface, cameras.world_to_camera, intrinsics))
        return hidden & is_behind(means.T, *of_view)


def _cameras(extrinsics: Tensor, intrinsics: Tensor) -> Cameras:
    return Cameras(extrinsics, intrinsics, torch.tensor(1.0), torch.tensor(1.0))
