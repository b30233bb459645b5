"""Names, modules and inputs of the graphs of the networks in floating point, and of the steps over pairs of views."""

import torch

from fecocodec.config import ReceiverConfig
from fecocodec.receiver.model import Receiver
from fecocodec.splatting.background import DEFAULT_BACKGROUND, cell_centres
from fecocodec.splatting.occluded import occluded_candidates
from fecocodec.training.graphs import pairs, prediction
from fecocodec.training.graphs.pairs import BehindGraph, CandidatesGraph, HideGraph, outside_candidates
from fecocodec.training.graphs.prediction import UpdateGraph
from fecocodec.training.graphs.specification import Graph, GraphInput

Inputs = dict[str, GraphInput]


def _floats(shape: str) -> GraphInput:
    return GraphInput(shape, torch.float32)


_SCALAR = GraphInput("", torch.int32)
_POSES = {"extrinsics": _floats("views 4 4"), "intrinsics": _floats("views 3 3")}
_CAMERAS = _POSES | {"far": _floats("")}
_GRID = "16*rows 16*columns"  # of the Gaussians
_MAPS = {"positions": _floats(f"views 3 {_GRID}"), "colours": _floats(f"views 3 {_GRID}")}
_OWN = {
    "positions": _floats(f"3 {_GRID}"),
    "colours": _floats(f"3 {_GRID}"),
    "extrinsics": _floats("4 4"),
    "intrinsics": _floats("3 3"),
}
_PAIR_INPUTS = _OWN | {f"{name}_there": of for name, of in _OWN.items()}
_PAIR_INPUTS |= {
    name: _floats(_GRID) for name in ("confirmed", "violation", "kept", "confirmed_there", "opacities_there")
}
_PAIR_INPUTS |= {name: _floats(f"3 3 {_GRID}") for name in ("matrix", "right")}
_PAIR_INPUTS |= {"surface_there": _floats("4 8*rows 8*columns"), "share": _floats(""), "share_there": _floats("")}


def network_graphs(receiver: Receiver) -> dict[str, Graph]:
    """Return the graphs by name, `model_files.ReceiverKind.graph_names` without those of the entropy model."""
    of_views = _state_graphs(receiver) | _attribute_graphs(receiver)
    if not receiver.config.kind.has_rules:
        return of_views
    return of_views | _pair_graphs(receiver.config) | _harmonics_graph(receiver.config) | _background_graphs()


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
    if config.detail_planes:
        attributes["detail"] = _floats(f"views {config.detail_planes} 4*rows 4*columns")
    outputs = ["positions", "scales", "rotations", "opacities", "colours"]
    outputs += ["surfaces"] if config.kind.has_rules else ["higher"] if config.sh_degree else []
    return {
        "attend": Graph(prediction.AttendGraph(receiver), attend, ("attended",)),
        "attributes": Graph(prediction.AttributesGraph(receiver), attributes, tuple(outputs)),
    }


def _pair_graphs(config: ReceiverConfig) -> dict[str, Graph]:
    def inputs(*names: str) -> Inputs:
        return {name: _PAIR_INPUTS[name] for name in names}

    own, pose = inputs("positions", "colours"), inputs("extrinsics", "intrinsics")
    pose_there = inputs("extrinsics_there", "intrinsics_there")
    return {
        "confirm": Graph(
            pairs.ConfirmGraph(config),
            own | inputs("surface_there") | pose_there | inputs("confirmed", "violation"),
            ("confirmed_after", "violation_after"),
        ),
        "free_space": Graph(
            pairs.FreeSpaceGraph(config),
            own
            | inputs("confirmed", "share", "surface_there", "confirmed_there", "share_there")
            | pose_there
            | inputs("violation"),
            ("violation_after",),
        ),
        "duplicates": Graph(
            pairs.DuplicatesGraph(config),
            inputs("positions") | pose | inputs("surface_there", "opacities_there") | pose_there | inputs("kept"),
            ("kept_after",),
        ),
        "slope": Graph(
            pairs.SlopeGraph(config),
            own | inputs("extrinsics", "positions_there", "colours_there") | pose_there | inputs("matrix", "right"),
            ("matrix_after", "right_after"),
        ),
    }


def _harmonics_graph(config: ReceiverConfig) -> dict[str, Graph]:
    equations = {name: _floats(f"views 3 3 {_GRID}") for name in ("matrix", "right")}
    inputs = _MAPS | {"extrinsics": _POSES["extrinsics"]} | equations
    return {"harmonics": Graph(prediction.HarmonicsGraph(config), inputs, ("harmonics",))}


def _background_graphs() -> dict[str, Graph]:
    cells = len(cell_centres(DEFAULT_BACKGROUND, torch.zeros(1)))
    fields = {"means": _floats("candidates 3"), "scales": _floats("candidates 3"), "rotations": _floats("candidates 4")}
    maps = {"positions": _MAPS["positions"], "opacities": _floats(f"views {_GRID}"), "colours": _MAPS["colours"]}
    hidden = {"hidden": GraphInput("candidates", torch.bool)}
    return {
        "background": Graph(
            CandidatesGraph(outside_candidates),
            maps | _POSES,
            (*fields, "candidate_opacities", "candidate_colours", "extended"),
        ),
        "hide": Graph(
            HideGraph(),
            {"view": _SCALAR} | fields | {"extended": _floats(f"views {cells} {cells}")} | _POSES | hidden,
            ("hidden_after",),
        ),
        "occluded": Graph(
            CandidatesGraph(occluded_candidates),
            maps | _POSES,
            (*fields, "candidate_opacities", "candidate_colours", "surface"),
        ),
        "behind": Graph(
            BehindGraph(),
            {"view": _SCALAR, "means": fields["means"], "surface": _floats("views 4*rows 4*columns")} | _POSES | hidden,
            ("hidden_after",),
        ),
    }


def _features(receiver: Receiver) -> GraphInput:
    return _floats(f"views {receiver.config.state_channels} 8*rows 8*columns")
