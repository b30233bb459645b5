"""Names, modules and inputs of the graphs of the networks in floating point, and of the steps over views."""

import torch

from fecocodec.receiver.background import DEFAULT_BACKGROUND, cell_centres
from fecocodec.receiver.model import Receiver
from fecocodec.training.graphs import prediction
from fecocodec.training.graphs.background import BackgroundGraph, HideGraph
from fecocodec.training.graphs.specification import Graph, GraphInput
from fecocodec.training.graphs.update import UpdateGraph

Inputs = dict[str, GraphInput]


def _floats(shape: str) -> GraphInput:
    return GraphInput(shape, torch.float32)


_SCALAR = GraphInput("", torch.int32)
_POSES = {"extrinsics": _floats("views 4 4"), "intrinsics": _floats("views 3 3")}
_CAMERAS = _POSES | {"far": _floats("")}
_GRID = "16*rows 16*columns"  # of the Gaussians
_MAPS = {"positions": _floats(f"views 3 {_GRID}"), "colours": _floats(f"views 3 {_GRID}")}
_SURFACES = {"surfaces": _floats("views 4 8*rows 8*columns")}
_EQUATIONS = {name: _floats(f"views 3 3 {_GRID}") for name in ("matrix", "right")}


def network_graphs(receiver: Receiver) -> dict[str, Graph]:
    """Return the graphs by name."""
    return _state_graphs(receiver) | _attribute_graphs(receiver) | _step_graphs(receiver) | _background_graphs()


def _state_graphs(receiver: Receiver) -> dict[str, Graph]:
    config = receiver.config
    step = GraphInput(f"4 views 2*rows 2*columns {config.latent_channels // 4}", torch.int32)
    state = {"state": _features(receiver), "lambda_q": _SCALAR, "stage": _SCALAR}
    steps = {f"step_{number}": step for number in range(4)}
    searched = ("points", "depth", "keys_values", "queries")
    return {
        "update": Graph(UpdateGraph(receiver), steps | state, ("state_after",)),
        "points": Graph(prediction.PointsGraph(receiver), state | _CAMERAS, ("features", "relative", *searched)),
    }


def _attribute_graphs(receiver: Receiver) -> dict[str, Graph]:
    config, grid = receiver.config, "4*rows 4*columns"
    attend: Inputs = {
        "asking": GraphInput("block", torch.int32),
        "neighbours": GraphInput(f"block {config.num_neighbours + 1}", torch.int32),
        "points": _floats(f"views {grid} 3"),
        "depth": _floats(f"views {grid}"),
        "keys_values": _floats(f"views {grid} {2 * config.attention_channels}"),
        "queries": _floats(f"views {grid} {config.attention_channels}"),
        "extrinsics": _POSES["extrinsics"],
    }
    attributes: Inputs = {
        "features": _features(receiver),
        "attended": _floats(f"views {grid} {config.state_channels}"),
        "relative": _floats("views 8*rows 8*columns"),
        **_CAMERAS,
    }
    outputs = ("positions", "scales", "rotations", "opacities", "colours", "surfaces")
    return {
        "attend": Graph(prediction.AttendGraph(receiver), attend, ("attended",)),
        "attributes": Graph(prediction.AttributesGraph(receiver), attributes, outputs),
    }


def _step_graphs(receiver: Receiver) -> dict[str, Graph]:
    config, shift = receiver.config, {"shift": _SCALAR}
    confirmed, violation = {"confirmed": _floats(f"views {_GRID}")}, {"violation": _floats(f"views {_GRID}")}
    share, opacities = {"share": _floats("views")}, {"opacities": _floats(f"views {_GRID}")}
    kept = {"kept": _floats(f"views {_GRID}")}
    slope = shift | _MAPS | _POSES | _EQUATIONS
    return {
        "confirm": Graph(
            prediction.ConfirmGraph(config),
            shift | _MAPS | _SURFACES | _POSES | confirmed | violation,
            ("confirmed_after", "violation_after"),
        ),
        "free_space": Graph(
            prediction.FreeSpaceGraph(config),
            shift | _MAPS | _SURFACES | confirmed | share | _POSES | violation,
            ("violation_after",),
        ),
        "duplicates": Graph(
            prediction.DuplicatesGraph(config),
            shift | {"positions": _MAPS["positions"]} | _SURFACES | opacities | _POSES | kept,
            ("kept_after",),
        ),
        "slope": Graph(prediction.SlopeGraph(config), slope, ("matrix_after", "right_after")),
        "harmonics": Graph(
            prediction.HarmonicsGraph(config),
            _MAPS | {"extrinsics": _POSES["extrinsics"]} | _EQUATIONS,
            ("harmonics",),
        ),
    }


def _background_graphs() -> dict[str, Graph]:
    cells = len(cell_centres(DEFAULT_BACKGROUND, torch.zeros(1)))
    fields = {"means": _floats("candidates 3"), "scales": _floats("candidates 3"), "rotations": _floats("candidates 4")}
    maps = {"positions": _MAPS["positions"], "opacities": _floats(f"views {_GRID}"), "colours": _MAPS["colours"]}
    hidden = {"hidden": GraphInput("candidates", torch.bool)}
    return {
        "background": Graph(
            BackgroundGraph(), maps | _POSES, (*fields, "candidate_opacities", "candidate_colours", "extended")
        ),
        "hide": Graph(
            HideGraph(),
            {"view": _SCALAR} | fields | {"extended": _floats(f"views {cells} {cells}")} | _POSES | hidden,
            ("hidden_after",),
        ),
    }


def _features(receiver: Receiver) -> GraphInput:
    return _floats(f"views {receiver.config.state_channels} 8*rows 8*columns")
