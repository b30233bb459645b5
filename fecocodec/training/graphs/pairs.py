"""Steps over pairs of views as graphs: the Gaussians of one view are compared with another view.

A caller runs a step for every other view, starting with the next one in cyclic order, and passes its results to the
next call. Inputs named `..._there` are of the other view.
"""

from collections.abc import Callable

import torch
from torch import Tensor, nn

from fecocodec.config import ReceiverConfig
from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import SH_DEGREE_0, Gaussians
from fecocodec.splatting.background import DEFAULT_BACKGROUND, cell_centres
from fecocodec.splatting.confirmation import confirmation_by
from fecocodec.splatting.duplicates import kept_beside, shown_surfaces
from fecocodec.splatting.free_space import near_bound_violation_by, violation_by, with_confirmation
from fecocodec.splatting.hidden import bounds_of, is_hidden_from, standard_deviations
from fecocodec.splatting.occluded import is_behind
from fecocodec.splatting.view_dependence import NormalEquations, surfaces_of, with_view


def normalised(extrinsics: Tensor, intrinsics: Tensor, far: Tensor | None = None) -> Cameras:
    """Return normalised cameras, in which near is 1, without batch dimension. far: None where it is not used."""
    return Cameras(extrinsics, intrinsics, torch.tensor(1.0), torch.tensor(1.0) if far is None else far)


def _camera(extrinsics: Tensor, intrinsics: Tensor) -> Cameras:
    return normalised(extrinsics[None], intrinsics[None])


class RulesGraph(nn.Module):
    """A graph of a rule, whose constants are in the configuration."""

    def __init__(self, config: ReceiverConfig) -> None:
        super().__init__()
        self.config = config


class ConfirmGraph(RulesGraph):
    """Another view -> confirmation, and violation of the near bound; for three or more views."""

    def forward(
        self,
        positions: Tensor,
        colours: Tensor,
        surface_there: Tensor,
        extrinsics_there: Tensor,
        intrinsics_there: Tensor,
        confirmed: Tensor,
        violation: Tensor,
    ) -> tuple[Tensor, Tensor]:
        there = _camera(extrinsics_there, intrinsics_there)
        found = confirmation_by(positions[None], colours[None], surface_there[None], there, self.config)[0]
        too_near = near_bound_violation_by(positions[None], there, self.config)[0]
        return torch.maximum(confirmed, found), torch.maximum(violation, too_near)


class FreeSpaceGraph(RulesGraph):
    """Another view -> violation. share: mean confirmation of the view; 1 for fewer than three views."""

    def forward(
        self,
        positions: Tensor,
        colours: Tensor,
        confirmed: Tensor,
        share: Tensor,
        surface_there: Tensor,
        confirmed_there: Tensor,
        share_there: Tensor,
        extrinsics_there: Tensor,
        intrinsics_there: Tensor,
        violation: Tensor,
    ) -> Tensor:
        there = _camera(extrinsics_there, intrinsics_there)
        surfaces = with_confirmation(surface_there[None], confirmed_there[None])
        own = positions[None], colours[None], confirmed[None], share[None]
        found = violation_by(*own, surfaces, share_there[None], there, self.config)
        return torch.maximum(violation, found[0])


class DuplicatesGraph(RulesGraph):
    """Another view -> share of their opacity that Gaussians keep beside finer ones; for three or more views."""

    def forward(
        self,
        positions: Tensor,
        extrinsics: Tensor,
        intrinsics: Tensor,
        surface_there: Tensor,
        opacities_there: Tensor,
        extrinsics_there: Tensor,
        intrinsics_there: Tensor,
        kept: Tensor,
    ) -> Tensor:
        camera, there = _camera(extrinsics, intrinsics), _camera(extrinsics_there, intrinsics_there)
        shown = shown_surfaces(surface_there[None], opacities_there[None])
        return kept * kept_beside(positions[None], camera, shown, there, self.config)[0]


class SlopeGraph(RulesGraph):
    """Another view -> normal equations of the slopes of colours. Those before the first one are zero."""

    def forward(
        self,
        positions: Tensor,
        colours: Tensor,
        extrinsics: Tensor,
        positions_there: Tensor,
        colours_there: Tensor,
        extrinsics_there: Tensor,
        intrinsics_there: Tensor,
        matrix: Tensor,
        right: Tensor,
    ) -> tuple[Tensor, Tensor]:
        camera = _camera(extrinsics, extrinsics[:3, :3])  # intrinsics are not used
        there = _camera(extrinsics_there, intrinsics_there)
        surfaces = surfaces_of(positions_there[None], colours_there[None], there)
        before, own = NormalEquations(matrix[None], right[None]), (positions[None], colours[None])
        after = with_view(before, *own, camera, surfaces, there, self.config)
        return after.matrix[0], after.right[0]


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
        found, depth = self.find(gaussians, normalised(extrinsics, intrinsics), grid)
        return *found.fields(), depth


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
        cameras = normalised(extrinsics, intrinsics)
        of_view = (x.index_select(0, index)[0] for x in (extended, cameras.world_to_camera, intrinsics))
        candidates = Gaussians(means, scales, rotations, means[:, 0], means[:, None])  # opacity, colour are not used
        bounds = bounds_of(self.centres)
        return hidden & is_hidden_from(means.T, standard_deviations(candidates), bounds, *of_view)


class BehindGraph(nn.Module):
    """A view, candidates of the occluded part -> candidates that this view does not show, among the hidden ones."""

    def forward(
        self, view: Tensor, means: Tensor, surface: Tensor, extrinsics: Tensor, intrinsics: Tensor, hidden: Tensor
    ) -> Tensor:
        index = view[None].long()
        cameras = normalised(extrinsics, intrinsics)
        of_view = (x.index_select(0, index)[0] for x in (surface, cameras.world_to_camera, intrinsics))
        return hidden & is_behind(means.T, *of_view)
