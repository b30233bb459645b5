"""Names, modules and inputs of the graphs of a model."""

from dataclasses import dataclass

import torch
from torch import nn
from torch.export import Dim

from fecocodec.coding.priors import LatentPrior
from fecocodec.limits import MAX_SIDE, MAX_VIEWS, MIN_SIDE, SIDE_MULTIPLE
from fecocodec.receiver.model import Receiver
from fecocodec.training.graphs import prior as of_prior
from fecocodec.training.graphs.predict import BackgroundGraph, PointsGraph, PredictGraph
from fecocodec.training.graphs.update import UpdateGraph

# Variable dimensions; rows and columns are those at 1/32 resolution.
_DIMENSIONS = {
    "views": Dim("views", min=1, max=MAX_VIEWS),
    "rows": Dim("rows", min=MIN_SIDE // SIDE_MULTIPLE, max=MAX_SIDE // SIDE_MULTIPLE),
    "columns": Dim("columns", min=MIN_SIDE // SIDE_MULTIPLE, max=MAX_SIDE // SIDE_MULTIPLE),
}
# No other dimension has these sizes: the exporter takes dimensions of equal size for one.
_EXAMPLE = {"views": 7, "rows": 11, "columns": 13}


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


def network_graphs(receiver: Receiver) -> dict[str, Graph]:
    """Return the graphs of the networks in floating point, by name."""
    config = receiver.config
    scalar = GraphInput("", torch.int32)
    step = GraphInput(f"4 views 2*rows 2*columns {config.latent_channels // 4}", torch.int32)
    state = GraphInput(f"views {config.state_channels} 8*rows 8*columns", torch.float32)
    cameras = {
        "extrinsics": GraphInput("views 4 4", torch.float32),
        "intrinsics": GraphInput("views 3 3", torch.float32),
        "far": GraphInput("", torch.float32),
    }
    searched = {
        "relative": GraphInput("views 8*rows 8*columns", torch.float32),
        "points": GraphInput("views 4*rows 4*columns 3", torch.float32),
        "depth": GraphInput("views 4*rows 4*columns", torch.float32),
    }
    neighbours = GraphInput(f"views 4*rows 4*columns {config.num_neighbours + 1}", torch.int32)
    return {
        "update": Graph(
            UpdateGraph(receiver),
            {f"step_{number}": step for number in range(4)} | {"state": state, "lambda_q": scalar, "stage": scalar},
            ("state_after",),
        ),
        "points": Graph(
            PointsGraph(receiver),
            {"state": state, "lambda_q": scalar, "stage": scalar, **cameras},
            ("features", *searched),
        ),
        "predict": Graph(
            PredictGraph(receiver),
            {"features": state, **searched, "neighbours": neighbours, **cameras},
            ("means", "scales", "rotations", "opacities", "colours", "harmonics"),
        ),
        "background": Graph(
            BackgroundGraph(),
            {
                "means": GraphInput("views 16*rows 16*columns 3", torch.float32),
                "opacities": GraphInput("views 16*rows 16*columns", torch.float32),
                "colours": GraphInput("views 16*rows 16*columns 3", torch.float32),
                "extrinsics": cameras["extrinsics"],
                "intrinsics": cameras["intrinsics"],
            },
            ("means_out", "scales", "rotations", "opacities_out", "colours_out", "is_kept"),
        ),
    }
