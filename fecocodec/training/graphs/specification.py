"""Inputs of graphs, and the graphs of the entropy model."""

from dataclasses import dataclass

import torch
from torch import nn
from torch.export import Dim

from fecocodec.coding.priors import LatentPrior
from fecocodec.limits import MAX_SIDE, MAX_VIEWS, MIN_SIDE, SIDE_MULTIPLE
from fecocodec.training.graphs import prior as of_prior

# Variable dimensions; rows and columns are those at 1/32 resolution.
_DIMENSIONS = {
    "views": Dim("views", min=1, max=MAX_VIEWS),
    "rows": Dim("rows", min=MIN_SIDE // SIDE_MULTIPLE, max=MAX_SIDE // SIDE_MULTIPLE),
    "columns": Dim("columns", min=MIN_SIDE // SIDE_MULTIPLE, max=MAX_SIDE // SIDE_MULTIPLE),
    "block": Dim("block", min=1, max=1 << 16),
    "candidates": Dim("candidates", min=1, max=1 << 20),
}
# No other dimension has these sizes: the exporter takes dimensions of equal size for one.
_EXAMPLE = {"views": 7, "rows": 11, "columns": 13, "block": 37, "candidates": 53}


@dataclass(frozen=True)
class GraphInput:
    """An input of a graph. shape: dimensions, such as "views 4*rows 4*columns 32"; empty for a scalar."""

    shape: str
    dtype: torch.dtype

    def example(self) -> torch.Tensor:
        return torch.ones([self._size(word) for word in self.shape.split()], dtype=self.dtype)

    def dynamic(self) -> dict[int, Dim]:
        """Return the variable dimensions by axis."""
        words = enumerate(self.shape.split())
        return {axis: self._dimension(word) for axis, word in words if not word.isdecimal()}

    @staticmethod
    def _size(word: str) -> int:
        factor, _, name = word.rpartition("*")
        return int(factor or 1) * (_EXAMPLE[name] if name in _EXAMPLE else int(name))

    @staticmethod
    def _dimension(word: str) -> Dim:
        factor, _, name = word.rpartition("*")
        return int(factor) * _DIMENSIONS[name] if factor else _DIMENSIONS[name]


@dataclass(frozen=True)
class Graph:
    """A graph to export: its module, its inputs in the order of the module's arguments, the names of its outputs."""

    module: nn.Module
    inputs: dict[str, GraphInput]
    outputs: tuple[str, ...]


def prior_graphs(prior: LatentPrior) -> dict[str, Graph]:
    """Return the graphs of an entropy model with exact layers, by name."""
    quarter, width = prior.latent_channels // 4, prior.merge_8.weight.shape[-1]

    def values(shape: str) -> GraphInput:
        return GraphInput(shape, torch.int32)

    lambda_q, stage = values(""), values("")
    z_hat = values(f"views rows columns {prior.hyper_channels}")
    features = GraphInput(f"4 views 2*rows 2*columns {width}", torch.float64)
    quarter_pass, half_pass = values(f"4 views rows columns {quarter}"), values(f"4 views 2*rows columns {quarter}")
    step = values(f"4 views 2*rows 2*columns {quarter}")
    parameters = ("mean", "table")
    return {
        "hyper": Graph(of_prior.HyperGraph(prior), {"lambda_q": lambda_q, "stage": stage}, parameters),
        "features_1": Graph(
            of_prior.FeaturesGraph(prior), {"lambda_q": lambda_q, "z_hat": z_hat}, ("features", *parameters)
        ),
        "features_2": Graph(
            of_prior.ContextFeaturesGraph(prior),
            {"lambda_q": lambda_q, "z_hat": z_hat} | {f"context_{number}": step for number in range(4)},
            ("features", *parameters),
        ),
        "pass_1": Graph(of_prior.SecondPassGraph(prior), {"features": features, "pass_0": quarter_pass}, parameters),
        "pass_2": Graph(
            of_prior.ThirdPassGraph(prior),
            {"features": features, "pass_0": quarter_pass, "pass_1": quarter_pass},
            parameters,
        ),
        "step_1": Graph(
            of_prior.FirstStepGraph(prior),
            {"features": features, "pass_0": quarter_pass, "pass_1": quarter_pass, "pass_2": half_pass},
            ("step_0", *parameters),
        ),
        "step_2": Graph(
            of_prior.SecondStepGraph(prior), {"features": features, "step_0": step, "step_1": step}, parameters
        ),
        "step_3": Graph(
            of_prior.ThirdStepGraph(prior),
            {"features": features, "step_0": step, "step_1": step, "step_2": step},
            parameters,
        ),
    }
