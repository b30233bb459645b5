"""The background layer as graphs. Of each part: its candidates, and a step over views that finds the hidden ones."""

import torch
from torch import Tensor, nn

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import SH_DEGREE_0, Gaussians
from fecocodec.receiver.background import DEFAULT_BACKGROUND, background_candidates, cell_centres
from fecocodec.receiver.hidden import ExtendedDepth, is_hidden_from, standard_deviations
from fecocodec.receiver.occluded import is_behind, occluded_candidates


class BackgroundGraph(nn.Module):
    """Maps of the emitted Gaussians, cameras -> candidates of the background layer, and the extended depth of views.

    opacities: 0 for Gaussians that are not emitted.
    """

    def forward(
        self, positions: Tensor, opacities: Tensor, colours: Tensor, extrinsics: Tensor, intrinsics: Tensor
    ) -> tuple[Tensor, ...]:
        gaussians, cameras = _gaussians(positions, opacities, colours), _cameras(extrinsics, intrinsics)
        found, extended = background_candidates(gaussians, cameras, (opacities.shape[1], opacities.shape[2]))
        return *found.fields(), extended.depth


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


class OccludedGraph(nn.Module):
    """Maps of the emitted Gaussians, cameras -> candidates of the occluded part, and the depth of the views' surfaces.

    opacities: 0 for Gaussians that are not emitted.
    """

    def forward(
        self, positions: Tensor, opacities: Tensor, colours: Tensor, extrinsics: Tensor, intrinsics: Tensor
    ) -> tuple[Tensor, ...]:
        gaussians, cameras = _gaussians(positions, opacities, colours), _cameras(extrinsics, intrinsics)
        found, surface = occluded_candidates(gaussians, cameras, (opacities.shape[1], opacities.shape[2]))
        return *found.fields(), surface


class BehindGraph(nn.Module):
    """A view, candidates of the occluded part -> candidates that this view does not show, among the hidden ones."""

    def forward(
        self, view: Tensor, means: Tensor, surface: Tensor, extrinsics: Tensor, intrinsics: Tensor, hidden: Tensor
    ) -> Tensor:
        index = view[None].long()
        cameras = _cameras(extrinsics, intrinsics)
        of_view = (x.index_select(0, index)[0] for x in (surface, cameras.world_to_camera, intrinsics))
        return hidden & is_behind(means.T, *of_view)


def _gaussians(positions: Tensor, opacities: Tensor, colours: Tensor) -> Gaussians:
    """Return Gaussians without shapes, which the candidates do not depend on."""
    means = positions.permute(0, 2, 3, 1).flatten(0, 2)
    harmonics = (colours.permute(0, 2, 3, 1).flatten(0, 2)[:, None] - 0.5) / SH_DEGREE_0
    shapes = torch.zeros_like(means), torch.zeros_like(means)[:, [0, 0, 0, 0]]
    return Gaussians(means, *shapes, opacities.flatten(), harmonics)


def _cameras(extrinsics: Tensor, intrinsics: Tensor) -> Cameras:
    return Cameras(extrinsics, intrinsics, torch.tensor(1.0), torch.tensor(1.0))
