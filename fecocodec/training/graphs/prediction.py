"""The Gaussian predictor as graphs: networks, with the neighbour search between them, and the fitted harmonics."""

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from fecocodec.coding.fixed_point import ONE_Q8
from fecocodec.coding.quadtree import from_coding_order
from fecocodec.layers.blocks import RateCondition
from fecocodec.receiver.model import Receiver
from fecocodec.receiver.predictor import enlarged
from fecocodec.splatting.free_space import surfaces_of
from fecocodec.splatting.view_dependence import NormalEquations, harmonics_of
from fecocodec.training.graphs.exported_forms import upsampled
from fecocodec.training.graphs.pairs import RulesGraph, normalised


def rate_condition(receiver: Receiver, lambda_q: Tensor, stage: Tensor) -> RateCondition:
    """Return the condition of one stage for all views, with one item. lambda_q, stage: int32 scalars."""
    first, second = (receiver.condition(lambda_q[None], number) for number in (1, 2))
    return RateCondition(torch.where(stage == 1, first.embedding, second.embedding), first.latent_gain)


class _ReceiverGraph(nn.Module):
    def __init__(self, receiver: Receiver) -> None:
        super().__init__()
        self.receiver = receiver


class UpdateGraph(_ReceiverGraph):
    """Four steps of y, state before, lambda_q, stage -> state. The state before stage 1 may have any values."""

    def forward(
        self,
        step_0: Tensor,
        step_1: Tensor,
        step_2: Tensor,
        step_3: Tensor,
        state: Tensor,
        lambda_q: Tensor,
        stage: Tensor,
    ) -> Tensor:
        y_hat = from_coding_order(torch.stack((step_0, step_1, step_2, step_3)).float() / ONE_Q8)
        before = torch.where(stage == 1, self.receiver.update.initial_state, state)
        condition = rate_condition(self.receiver, lambda_q, stage)
        synthesis, update = self.receiver.synthesis, self.receiver.update
        coarse = synthesis.coarse(synthesis.input(y_hat / condition.latent_gain), condition)
        of_state, of_features = update.join.weight.chunk(2, dim=1)
        of_latent, of_before = self._upsampled_and_joined(coarse, of_features[:, :, 0, 0]), F.conv2d(before, of_state)
        # The sum has channels last, as the layer normalisation that follows.
        joined = (of_latent.permute(0, 2, 3, 1) + of_before.permute(0, 2, 3, 1)).permute(0, 3, 1, 2)
        after: Tensor = update.block(joined, condition)
        return after

    def _upsampled_and_joined(self, coarse: Tensor, of_features: Tensor) -> Tensor:
        """Return the part of the joining convolution that depends on g_s(y_hat), with its bias.

        The convolution of g_s before its pixel shuffle and the joining one are linear, so their product is one layer,
        which runtimes compute when they load the graph.
        """
        up, join = self.receiver.synthesis.up[0], self.receiver.update.join
        assert isinstance(up, nn.Conv2d)
        assert up.bias is not None
        assert join.bias is not None
        of_pixels = up.weight.flatten(1).unflatten(0, (-1, 4)).flatten(1)  # [channel, (pixel in)]
        weight = (of_features @ of_pixels).reshape(up.weight.shape[:2])
        bias = of_features @ up.bias.unflatten(0, (-1, 4)) + join.bias[:, None]
        return upsampled(coarse, weight, bias.flatten())


class PointsGraph(_ReceiverGraph):
    """State, lambda_q, stage, cameras -> features, relative disparity, points to search, and inputs of attention."""

    def forward(
        self, state: Tensor, lambda_q: Tensor, stage: Tensor, extrinsics: Tensor, intrinsics: Tensor, far: Tensor
    ) -> tuple[Tensor, ...]:
        cameras, predictor = normalised(extrinsics, intrinsics, far).as_batch(), self.receiver.predictor
        condition = rate_condition(self.receiver, lambda_q, stage)
        features, relative = predictor.geometry(state, cameras.num_views, condition)
        points, depth = predictor.attention_points(relative, cameras)
        size = (relative.shape[1], relative.shape[2] // 2, relative.shape[3] // 2)
        pooled = F.avg_pool2d(features, 2).permute(0, 2, 3, 1)
        key_value, query = predictor.attention.keys_values_and_queries(pooled.flatten(0, 2))
        return (
            features,
            relative[0],
            points.view(*size, 3),
            depth.view(*size),
            key_value.view(*size, key_value.shape[-1]),
            query.view(*size, query.shape[-1]),
        )


class AttendGraph(nn.Module):
    """A block of points and their neighbours, as indices in the order (view, row, column) -> residual features."""

    def __init__(self, receiver: Receiver) -> None:
        super().__init__()
        self.attention = receiver.predictor.attention

    def forward(
        self,
        asking: Tensor,
        neighbours: Tensor,
        points: Tensor,
        depth: Tensor,
        keys_values: Tensor,
        queries: Tensor,
        extrinsics: Tensor,
    ) -> Tensor:
        per_view = depth.shape[1] * depth.shape[2]
        all_points, asking = points.flatten(0, 2), asking.long()
        keys, values = keys_values.flatten(0, 2).chunk(2, dim=-1)
        gathered = self.attention.gathered(
            keys,
            values,
            all_points,
            neighbours.long(),
            queries.flatten(0, 2).index_select(0, asking),
            all_points.index_select(0, asking),
            depth.flatten().index_select(0, asking),
            extrinsics[:, :3, :3].transpose(1, 2).index_select(0, asking // per_view),
        )
        residual: Tensor = self.attention.output(gathered)
        return residual


class AttributesGraph(_ReceiverGraph):
    """Features, residual of attention, cameras -> attributes before the free-space check, and surfaces of the views.

    The last input are the numbers of the detail layer, if the model has one. Without rules there are no surfaces, but
    the harmonics above degree 0, if the model has any.
    """

    def forward(
        self,
        features: Tensor,
        attended: Tensor,
        relative: Tensor,
        extrinsics: Tensor,
        intrinsics: Tensor,
        far: Tensor,
        detail: Tensor | None = None,
    ) -> tuple[Tensor, ...]:
        cameras = normalised(extrinsics, intrinsics, far).as_batch()
        residual = enlarged(attended.permute(0, 3, 1, 2))
        added = None if detail is None else self.receiver.detail_basis(detail)
        found = self.receiver.predictor.at_head(features, residual, relative[None], cameras, added).attributes
        positions, colours = (x.permute(0, 1, 4, 2, 3).contiguous() for x in (found.means, found.colour))
        scales, rotations = (x[0].flatten(0, 2) for x in (found.scales, found.rotations))
        attributes = positions[0], scales, rotations, found.opacity[0], colours[0]
        if not self.receiver.config.kind.has_rules:
            return (*attributes, found.higher[0].flatten(0, 2)) if self.receiver.config.sh_degree else attributes
        return *attributes, surfaces_of(found.depth, colours, found.opacity)[0]


class HarmonicsGraph(RulesGraph):
    """Normal equations of the slopes -> spherical harmonics of degree 1."""

    def forward(self, positions: Tensor, colours: Tensor, extrinsics: Tensor, matrix: Tensor, right: Tensor) -> Tensor:
        cameras = normalised(extrinsics, extrinsics[:, :3, :3])  # intrinsics are not used
        return harmonics_of(NormalEquations(matrix, right), positions, colours, cameras, self.config)
