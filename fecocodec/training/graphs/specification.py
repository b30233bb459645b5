"""Inputs of graphs, and the graphs of the entropy model."""

from dataclasses import dataclass
from inspect import signature

import torch
from einops import rearrange
from torch import Tensor, nn
from torch.export import Dim

from fecocodec.coding.fixed_point import ONE_Q8
from fecocodec.coding.priors import LAMBDA_Q_CENTRE, NUM_STAGES, EntropyParameters, LatentPrior
from fecocodec.coding.quadtree import from_coding_order, merge_passes
from fecocodec.grid import HYPERLATENTS
from fecocodec.limits import MAX_SIDE, MAX_VIEWS, MIN_SIDE


def _outputs(parameters: EntropyParameters) -> tuple[Tensor, Tensor]:
    return parameters.mean_q8.to(torch.int32), parameters.table_index().to(torch.uint8)


class _PriorGraph(nn.Module):
    def __init__(self, prior: LatentPrior) -> None:
        super().__init__()
        self.prior = prior


def _condition(lambda_q: Tensor, stage: Tensor) -> Tensor:
    """Return the condition of the entropy model, [1 4]. lambda_q, stage: int32 scalars."""
    is_stage = torch.stack([stage == number for number in range(1, NUM_STAGES + 1)]).double()
    return torch.cat((ONE_Q8 * is_stage, (lambda_q - LAMBDA_Q_CENTRE).double() * is_stage))[None]


class HyperGraph(_PriorGraph):
    """lambda_q, stage -> mean and table index of each channel of z, equal at all positions."""

    def forward(self, lambda_q: Tensor, stage: Tensor) -> tuple[Tensor, Tensor]:
        mean, table = _outputs(self.prior.hyper_parameters(_condition(lambda_q, stage), 1, 1))
        return mean.flatten(), table.flatten()


class FeaturesGraph(_PriorGraph):
    """lambda_q, z_hat -> features of stage 1, and the parameters of the first batch of y."""

    def forward(self, lambda_q: Tensor, z_hat: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        return _features(self.prior, lambda_q, 1, z_hat, None)


class ContextFeaturesGraph(_PriorGraph):
    """lambda_q, z_hat of stage 2 and the four steps of y of stage 1 -> the same for stage 2."""

    def forward(
        self,
        lambda_q: Tensor,
        z_hat: Tensor,
        context_0: Tensor,
        context_1: Tensor,
        context_2: Tensor,
        context_3: Tensor,
    ) -> tuple[Tensor, Tensor, Tensor]:
        y_hat = from_coding_order(torch.stack((context_0, context_1, context_2, context_3)))
        return _features(self.prior, lambda_q, 2, z_hat, rearrange(y_hat.double(), "n c h w -> n h w c"))


def _features(
    prior: LatentPrior, lambda_q: Tensor, stage: int, z_hat: Tensor, context: Tensor | None
) -> tuple[Tensor, Tensor, Tensor]:
    condition = _condition(lambda_q, torch.tensor(stage)).expand(z_hat.shape[0], -1)
    features = prior.features(z_hat.double(), condition, context)
    return features, *_outputs(prior.block_parameters(features, []))


class PassGraph(_PriorGraph):
    """features, one or two passes -> parameters of the next pass."""

    def forward(self, features: Tensor, pass_0: Tensor, pass_1: Tensor | None = None) -> tuple[Tensor, Tensor]:
        passes = [one.double() for one in (pass_0, pass_1) if one is not None]
        return _outputs(self.prior.block_parameters(features, passes))


class FirstStepGraph(_PriorGraph):
    """features, the three passes -> step 0 as one array, and the parameters of step 1."""

    def forward(self, features: Tensor, pass_0: Tensor, pass_1: Tensor, pass_2: Tensor) -> tuple[Tensor, ...]:
        step_0 = merge_passes([pass_0, pass_1, pass_2])
        return step_0, *_outputs(self.prior.steps["1"]([features, self.prior.surroundings(step_0.double())]))


class StepGraph(_PriorGraph):
    """features, two or three steps -> parameters of the next step."""

    def forward(
        self, features: Tensor, step_0: Tensor, step_1: Tensor, step_2: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        around = [self.prior.surroundings(step.double()) for step in (step_0, step_1, step_2) if step is not None]
        return _outputs(self.prior.steps[str(len(around))]([features, *around]))


# Variable dimensions; rows and columns are those at 1/32 resolution.
_DIMENSIONS = {
    "views": Dim("views", min=1, max=MAX_VIEWS),
    "rows": Dim("rows", min=MIN_SIDE // HYPERLATENTS, max=MAX_SIDE // HYPERLATENTS),
    "columns": Dim("columns", min=MIN_SIDE // HYPERLATENTS, max=MAX_SIDE // HYPERLATENTS),
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


def graph_of(module: nn.Module, known: dict[str, GraphInput], *outputs: str) -> Graph:
    """Return the graph of a module. known: inputs by name, among them those that its `forward` takes."""
    names = signature(module.forward).parameters
    return Graph(module, {name: known[name] for name in names if name in known}, outputs)


def prior_graphs(prior: LatentPrior) -> dict[str, Graph]:
    """Return the graphs of an entropy model with exact layers, by name."""
    quarter, width = prior.latent_channels // 4, prior.merge_8.weight.shape[-1]

    def values(shape: str) -> GraphInput:
        return GraphInput(shape, torch.int32)

    features = GraphInput(f"4 views 2*rows 2*columns {width}", torch.float64)
    first = {"features": features, "pass_0": values(f"4 views rows columns {quarter}")}
    passes = first | {"pass_1": first["pass_0"], "pass_2": values(f"4 views 2*rows columns {quarter}")}
    step = values(f"4 views 2*rows 2*columns {quarter}")
    two_steps = {"features": features, "step_0": step, "step_1": step}
    z_hat = values(f"views rows columns {prior.hyper_channels}")
    known = {"lambda_q": values(""), "stage": values(""), "z_hat": z_hat}
    known |= {f"context_{number}": step for number in range(4)}
    parameters = ("mean", "table")
    return {
        "hyper": graph_of(HyperGraph(prior), known, *parameters),
        "features_1": graph_of(FeaturesGraph(prior), known, "features", *parameters),
        "features_2": graph_of(ContextFeaturesGraph(prior), known, "features", *parameters),
        "pass_1": graph_of(PassGraph(prior), first, *parameters),
        "pass_2": graph_of(PassGraph(prior), passes, *parameters),
        "step_1": graph_of(FirstStepGraph(prior), passes, "step_0", *parameters),
        "step_2": graph_of(StepGraph(prior), two_steps, *parameters),
        "step_3": graph_of(StepGraph(prior), two_steps | {"step_2": step}, *parameters),
    }
