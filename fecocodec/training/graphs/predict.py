"""The Gaussian predictor as two graphs with the neighbour search between them, and the background layer."""

import torch
from torch import Tensor, nn

from fecocodec.geometry.cameras import Cameras
from fecocodec.geometry.gaussians import Gaussians
from fecocodec.receiver.background import background_candidates
from fecocodec.receiver.model import Receiver
from fecocodec.receiver.view_dependence import fitted_harmonics
from fecocodec.training.graphs.update import rate_condition


def _cameras(extrinsics: Tensor, intrinsics: Tensor, far: Tensor) -> Cameras:
    """Return normalised cameras, in which near is 1, with one batch dimension."""
    return Cameras(extrinsics[None], intrinsics[None], torch.ones(1), far[None])


class PointsGraph(nn.Module):
    """State, lambda_q, stage, cameras -> features, relative disparity, and the points to search with their depths."""

    def __init__(self, receiver: Receiver) -> None:
        super().__init__()
        self.receiver = receiver

    def forward(
        self, state: Tensor, lambda_q: Tensor, stage: Tensor, extrinsics: Tensor, intrinsics: Tensor, far: Tensor
    ) -> tuple[Tensor, ...]:
        cameras, predictor = _cameras(extrinsics, intrinsics, far), self.receiver.predictor
        condition = rate_condition(self.receiver, lambda_q, stage)
        features, relative = predictor.geometry(state, cameras.num_views, condition)
        points, depth = predictor.attention_points(relative, cameras)
        size = (relative.shape[1], relative.shape[2] // 2, relative.shape[3] // 2)
        return features, relative[0], points.view(*size, 3), depth.view(*size)


class PredictGraph(nn.Module):
    """Outputs of `PointsGraph`, neighbours, cameras -> Gaussians in the normalised frame, before culling.

    colours: harmonics of degree 0, [n 1 3]. harmonics: of degree 1, [n 4 3].
    """

    def __init__(self, receiver: Receiver) -> None:
        super().__init__()
        self.receiver = receiver

    def forward(
        self,
        features: Tensor,
        relative: Tensor,
        points: Tensor,
        depth: Tensor,
        neighbours: Tensor,
        extrinsics: Tensor,
        intrinsics: Tensor,
        far: Tensor,
    ) -> tuple[Tensor, ...]:
        cameras, predictor = _cameras(extrinsics, intrinsics, far), self.receiver.predictor
        searched = (points.flatten(0, 2)[None], depth.flatten()[None], neighbours.flatten(0, 2)[None].long())
        attended = predictor.attended(features, *searched, cameras)
        found = predictor.gaussians(features, attended, relative[None], cameras).gaussians.scene(0)
        grid = (2 * relative.shape[1], 2 * relative.shape[2])
        harmonics = fitted_harmonics(found.means, found.harmonics, cameras.scene(0), grid, self.receiver.config)
        return found.means, found.scales, found.rotations, found.opacities, found.harmonics, harmonics


class BackgroundGraph(nn.Module):
    """Gaussians of the 1/2 grids, cameras -> candidates of the background layer, and which of them it consists of.

    colours: harmonics of degree 0. opacities: 0 for Gaussians that are not emitted.
    """

    def forward(
        self, means: Tensor, opacities: Tensor, colours: Tensor, extrinsics: Tensor, intrinsics: Tensor
    ) -> tuple[Tensor, ...]:
        grid = (means.shape[1], means.shape[2])
        flat = (means.flatten(0, 2), opacities.flatten(), colours.flatten(0, 2)[:, None])
        shapes = torch.zeros_like(flat[0]), torch.zeros_like(flat[0])[:, [0, 0, 0, 0]]  # not used
        gaussians = Gaussians(flat[0], *shapes, flat[1], flat[2])
        cameras = Cameras(extrinsics, intrinsics, torch.tensor(1.0), torch.tensor(1.0))
        found, is_kept = background_candidates(gaussians, cameras, grid)
        return *found.fields(), is_kept
